import numpy as np
import pytest

from readygo.common.rasterizer.cpu.workspace import NODE, RECORD, make_depths, make_workspace, tile_count, with_room


@pytest.mark.parametrize(("height_px", "width_px", "tiles"), [(16, 16, 1), (17, 16, 2), (33, 49, 12)])
def test_tiles_cover_the_image(height_px: int, width_px: int, tiles: int) -> None:
    assert tile_count(height_px, width_px) == tiles
    assert len(make_depths(height_px, width_px).median) == 256 * tiles


def test_room_is_made_for_records_and_for_entries_apart() -> None:
    ws = make_workspace(160, 160)
    more = with_room(ws, records=1000)
    assert len(more.records) >= 1000 * RECORD
    assert len(more.boxes) >= 2000
    assert all(len(keys) >= 1000 for keys in (more.keys, more.sorted_keys, more.later))
    assert more.entry_record is ws.entry_record
    lists = with_room(more, entries=5000)
    # Each of the 100 tiles may have begun two nodes without having filled them.
    assert len(lists.node_next) > 5000 // NODE + 2 * 100
    assert len(lists.entry_record) == len(lists.entry_blocks) == NODE * len(lists.node_next)
    assert lists.records is more.records


def test_room_that_is_there_is_kept() -> None:
    ws = with_room(make_workspace(32, 48), records=1000, entries=5000)
    assert with_room(ws, records=1000, entries=5000) == ws


def test_buffers_of_kernels_begin_on_a_cache_line() -> None:
    ws = with_room(make_workspace(32, 48), records=77, entries=777)
    arrays = (ws.records, ws.keys, ws.tile_state, ws.entry_record, ws.entry_blocks, ws.scratch)
    assert [array.ctypes.data % 64 for array in arrays] == [0] * len(arrays)
    assert ws.entry_blocks.dtype == np.uint16


def test_neighbours_of_the_last_tile_can_be_read() -> None:
    ws = make_workspace(32, 48)
    last, columns = len(ws.quad_alive) - 1, 3
    assert len(ws.tile_alive) > last + columns + 1
