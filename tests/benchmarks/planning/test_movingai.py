import os

import numpy as np
import pytest

from readygo.benchmarks.planning.movingai import load_movingai_map
from readygo.common.errors import SceneError

TEXT = "type octile\nheight 2\nwidth 4\nmap\n.@TS\nGW..\n"


def test_ground_is_free_and_the_last_line_is_the_smallest_y(tmp_path):
    (tmp_path / "a.map").write_text(TEXT)
    found = load_movingai_map(tmp_path / "a.map", 0.5)
    np.testing.assert_array_equal(found.occupied, [[0, 1, 0, 0], [0, 1, 1, 0]])
    assert (found.frame.origin_x_m, found.frame.origin_y_m, found.frame.resolution_m) == (0.0, 0.0, 0.5)


@pytest.mark.parametrize(
    "text",
    ["", "type octile\nheight 2\n", TEXT[:-3], TEXT.replace("height 2", "height 3"), TEXT.replace("octile", "tile")],
)
def test_files_that_are_no_such_map_are_refused_in_one_line(tmp_path, text):
    (tmp_path / "a.map").write_text(text)
    with pytest.raises(SceneError, match="no MovingAI map") as caught:
        load_movingai_map(tmp_path / "a.map", 0.2)
    assert "\n" not in str(caught.value)


def test_missing_file_and_impossible_resolution_are_named(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        load_movingai_map(tmp_path / "none.map", 0.2)
    with pytest.raises(ValueError, match="resolution_m must be positive"):
        load_movingai_map(tmp_path / "none.map", float("nan"))


def test_city_maps_have_their_published_size(shared_data):
    for name, cells in (("Berlin_1_256", 256), ("NewYork_0_512", 512)):
        occupancy = load_movingai_map(shared_data / "maps" / "movingai" / f"{name}.map", 0.2)
        assert occupancy.occupied.shape == (cells, cells)
        assert 0.2 < occupancy.occupied.mean() < 0.8


def test_pipes_and_other_bytes_are_refused_in_one_line(tmp_path):
    os.mkfifo(tmp_path / "pipe.map")
    with pytest.raises(SceneError, match=r"pipe\.map cannot be read: it is a pipe or a device"):
        load_movingai_map(tmp_path / "pipe.map", 0.5)
    (tmp_path / "a.map").write_bytes(b"\xff")
    with pytest.raises(SceneError, match=r"a\.map cannot be read: 'ascii'"):
        load_movingai_map(tmp_path / "a.map", 0.5)
