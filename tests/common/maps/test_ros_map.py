import math
import os

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.maps import GridFrame, OccupancyMap, load_ros_map, save_ros_map
from readygo.common.maps.ros_map import load_unknown_cells

FRAME = GridFrame(origin_x_m=-1.25, origin_y_m=3.1, resolution_m=0.05)


def example():
    occupied = np.zeros((5, 8), np.bool_)
    occupied[0, :] = True
    occupied[3, 6] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def write(folder, pixels, *, name="map.png", **fields):
    cv2.imwrite(str(folder / name), pixels)
    values = {"image": name, "resolution": "0.1", "origin": "[0, 0, 0]", "negate": "0"}
    values |= {"occupied_thresh": "0.65", "free_thresh": "0.196"} | fields
    path = folder / "map.yaml"
    path.write_text("\n".join(f"{key}: {value}" for key, value in values.items()))
    return path


@pytest.mark.parametrize("picture_format", ["png", "pgm"])
def test_saved_map_loads_unchanged(tmp_path, picture_format):
    save_ros_map(example(), tmp_path / "a.yaml", picture_format=picture_format)
    back = load_ros_map(tmp_path / "a.yaml")
    np.testing.assert_array_equal(back.occupied, example().occupied)
    assert (back.frame.origin_x_m, back.frame.origin_y_m, back.frame.resolution_m) == (-1.25, 3.1, 0.05)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([f"a.{picture_format}", "a.yaml"])


def test_first_row_of_the_picture_is_the_largest_y(tmp_path):
    save_ros_map(example(), tmp_path / "a.yaml")
    pixels = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED)
    assert (pixels[-1] == 0).all()
    assert pixels[1, 6] == 0
    assert pixels[0, 0] == 254


def test_unknown_cells_are_grey_and_count_as_occupied(tmp_path):
    unknown = np.zeros((5, 8), np.bool_)
    unknown[4, 0] = True
    save_ros_map(example(), tmp_path / "a.yaml", unknown=unknown)
    assert load_ros_map(tmp_path / "a.yaml").occupied[4, 0]
    np.testing.assert_array_equal(load_unknown_cells(tmp_path / "a.yaml"), unknown)


def test_thresholds_and_negate_follow_map_server(tmp_path):
    pixels = np.uint8([[0, 88, 92, 204, 206, 255]])
    np.testing.assert_array_equal(load_ros_map(write(tmp_path, pixels)).occupied, [[1, 1, 1, 1, 0, 0]])
    np.testing.assert_array_equal(load_ros_map(write(tmp_path, pixels, negate="1")).occupied, [[0, 1, 1, 1, 1, 1]])


def test_transparent_pixels_are_unknown(tmp_path):
    pixels = np.full((1, 3, 4), 254, np.uint8)
    pixels[0, :, 3] = (255, 0, 255)
    np.testing.assert_array_equal(load_ros_map(write(tmp_path, pixels)).occupied, [[0, 1, 0]])


def test_colour_and_16_bit_pictures_are_read(tmp_path):
    colour = np.uint8([[[254, 254, 254], [0, 0, 0]]])
    np.testing.assert_array_equal(load_ros_map(write(tmp_path, colour)).occupied, [[0, 1]])
    deep = np.uint16([[65000, 100]])
    np.testing.assert_array_equal(load_ros_map(write(tmp_path, deep)).occupied, [[0, 1]])


@pytest.mark.parametrize("turns", [-1, 0, 1, 2, 3])
def test_quarter_turns_of_the_origin_place_cells_where_ros_does(tmp_path, turns):
    pixels = np.full((3, 5), 255, np.uint8)
    pixels[2, 4] = 0
    yaw = turns * math.pi / 2
    found = load_ros_map(write(tmp_path, pixels, origin=f"[2.0, -1.0, {yaw:.3f}]"))
    local_x, local_y = 4.5 * 0.1, 0.5 * 0.1
    x = 2.0 + math.cos(yaw) * local_x - math.sin(yaw) * local_y
    y = -1.0 + math.sin(yaw) * local_x + math.cos(yaw) * local_y
    assert found.occupied.sum() == 1
    assert found.occupied[found.frame.cell(x, y)]


def test_block_lists_comments_and_quotes_in_the_yaml(tmp_path):
    path = write(tmp_path, np.full((2, 2), 255, np.uint8))
    text = 'image: "map.png"  # picture\nresolution: 0.2\norigin:\n  - 1.5\n  - -2.5\n  - 0.0\nnegate: 0\n'
    path.write_text("# a map\n" + text + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    frame = load_ros_map(path).frame
    assert (frame.origin_x_m, frame.origin_y_m, frame.resolution_m) == (1.5, -2.5, 0.2)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"origin": "[0, 0, 0.3]"}, "quarter turns"),
        ({"resolution": "0"}, "positive resolution"),
        ({"resolution": "-0.05"}, "positive resolution"),
        ({"resolution": "nan"}, "positive resolution"),
        ({"resolution": "inf"}, "positive resolution"),
        ({"resolution": "fine"}, "not a number"),
        ({"origin": "[nan, 0, 0]"}, "finite origin"),
        ({"occupied_thresh": "nan"}, "occupied_thresh <= 1"),
        ({"free_thresh": "0.9"}, "free_thresh <= occupied_thresh"),
        ({"origin": "[1]"}, "not a number"),
        ({"mode": "raw"}, "mode 'raw'"),
        ({"image": "gone.png"}, "gone.png cannot be read"),
        ({"image": ""}, "cannot be read"),
    ],
)
def test_wrong_fields_are_refused_in_one_line(tmp_path, fields, message):
    path = write(tmp_path, np.full((2, 2), 255, np.uint8), **fields) if "image" not in fields else None
    if path is None:
        path = write(tmp_path, np.full((2, 2), 255, np.uint8))
        path.write_text(path.read_text().replace("map.png", fields["image"]))
    with pytest.raises(SceneError, match=message) as caught:
        load_ros_map(path)
    assert "\n" not in str(caught.value)


def test_missing_yaml_key_and_broken_picture_are_named(tmp_path):
    path = write(tmp_path, np.full((2, 2), 255, np.uint8))
    path.write_text("image: map.png\n")
    with pytest.raises(SceneError, match="lacks the key"):
        load_ros_map(path)
    path = write(tmp_path, np.full((2, 2), 255, np.uint8))
    (tmp_path / "map.png").write_bytes(b"not a picture")
    with pytest.raises(SceneError, match="not a png or pgm"):
        load_ros_map(path)
    with pytest.raises(SceneError, match="cannot be read"):
        load_ros_map(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (b"P5\n40 20\n255\nfew", "truncated"),
        (b"P5\n400000 200000\n255\nfew", "claims 400000 x 200000 pixels, more than"),
        (b"P7\nno picture", "not a png or pgm"),
        (b"\x89PNG\r\n\x1a\n", "truncated"),
    ],
)
def test_pictures_without_all_their_pixels_are_refused(tmp_path, data, message):
    path = write(tmp_path, np.full((2, 2), 255, np.uint8))
    (tmp_path / "map.png").write_bytes(data)
    with pytest.raises(SceneError, match=message) as caught:
        load_ros_map(path)
    assert "\n" not in str(caught.value)


def test_colour_picture_with_alpha_and_negate_is_read_like_a_grey_one(tmp_path):
    pixels = np.zeros((1, 3, 4), np.uint8)
    pixels[0, :, :3] = np.array([[0], [128], [255]])
    pixels[0, :, 3] = 255
    np.testing.assert_array_equal(load_ros_map(write(tmp_path, pixels, negate="true")).occupied, [[0, 1, 1]])
    np.testing.assert_array_equal(load_unknown_cells(write(tmp_path, pixels, negate="true")), [[0, 1, 0]])


def test_every_real_map_survives_export_and_import(shared_data, tmp_path):
    paths = sorted((shared_data / "maps").rglob("*.yaml"))
    assert len(paths) >= 11
    for path in paths:
        first, unknown = load_ros_map(path), load_unknown_cells(path)
        save_ros_map(first, tmp_path / "again.yaml", unknown=unknown, picture_format="pgm")
        again = load_ros_map(tmp_path / "again.yaml")
        assert again.frame.origin_x_m == first.frame.origin_x_m
        assert again.frame.resolution_m == first.frame.resolution_m
        np.testing.assert_array_equal(again.occupied, first.occupied)
        np.testing.assert_array_equal(load_unknown_cells(tmp_path / "again.yaml"), unknown)


def test_maps_of_real_robots_have_the_size_of_their_buildings(shared_data):
    for name, free_m2 in (("willow/willow-full-0.05", 1373), ("strands_giraff/movecare_map1", 98)):
        occupancy = load_ros_map(shared_data / "maps" / f"{name}.yaml")
        area_m2 = (~occupancy.occupied).sum() * occupancy.frame.resolution_m**2
        assert area_m2 == pytest.approx(free_m2, rel=0.01)


def test_picture_that_is_no_file_is_refused_in_one_line(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    for name, message in (
        ("pipe.png", "a pipe or a device"),
        (r'"a\0b.png"', "no file can have this name"),
        (".", "direc"),
    ):
        (tmp_path / "map.yaml").write_text(f"image: {name}\nresolution: 0.05\norigin: [0, 0, 0]\n")
        with pytest.raises(SceneError, match=message) as caught:
            load_ros_map(tmp_path / "map.yaml")
        assert "\n" not in str(caught.value)
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(SceneError, match="pipe\\.yaml cannot be read: it is a pipe or a device"):
        load_ros_map(tmp_path / "pipe.yaml")
