import json

import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews, load_views, views_text
from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_axis_angle
from tests.common.gaussians.other_formats import camera_row


def pose(axis_angle, centre):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = matrix_from_axis_angle(axis_angle), centre
    return T


@pytest.fixture
def load(tmp_path):
    """Cameras of rows, through a file."""

    def load(rows):
        (tmp_path / "rows.json").write_text(json.dumps(rows))
        return load_views(tmp_path / "rows.json")

    return load


POSES = [pose([0.1 * k, 1.0, -0.2], [k, 2, -3]) for k in range(4)]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([camera_row(k, T, width=640 + k, focal=500.0 + k) for k, T in enumerate(POSES)]))
    return path


def test_cameras_of_3dgs_are_read(file):
    views = load_views(file)
    assert views.images == ("frame_00000", "frame_00001", "frame_00002", "frame_00003")
    np.testing.assert_allclose(views.T_world_camera, POSES)
    np.testing.assert_array_equal(views.sizes_px[1], [641, 480])
    np.testing.assert_array_equal(views.K_px[1], [[501, 0, 320.5], [0, 501, 240], [0, 0, 1]])


def test_written_cameras_come_back(file, tmp_path):
    views = load_views(file)
    views.K_px[2, 0, 2] = 311.5
    (tmp_path / "again.json").write_text(views_text(views))
    again = load_views(tmp_path / "again.json")
    assert again.images == views.images
    for name in ("sizes_px", "K_px", "T_world_camera"):
        np.testing.assert_allclose(getattr(again, name), getattr(views, name), rtol=1e-12)


def test_moved_cameras_see_moved_points_where_they_saw_them(file):
    views = load_views(file)
    R, t, scale = matrix_from_axis_angle([0.3, 0.2, -0.9]), np.array([4.0, -1.0, 2.0]), 1.7
    moved = views.transform(R, t, scale)
    p = np.array([0.4, -3.0, 5.0])
    seen = np.linalg.inv(views.T_world_camera) @ [*p, 1]
    again = np.linalg.inv(moved.T_world_camera) @ [*(scale * R @ p + t), 1]
    np.testing.assert_allclose(again[:, :3], scale * seen[:, :3], atol=1e-9)


def test_cameras_that_are_turned_alone_keep_their_distances(file):
    views = load_views(file)
    R = matrix_from_axis_angle([0.3, 0.2, -0.9])
    np.testing.assert_allclose(
        views.transform(R).T_world_camera[:, :3, 3], views.T_world_camera[:, :3, 3] @ R.T, atol=1e-12
    )


def test_mean_up_is_that_of_level_cameras_that_look_around(load):
    # Level cameras in a z-up world: x right, y down, z along the yaw.
    poses = []
    for yaw in np.linspace(0, 6, 9):
        T = np.eye(4)
        T[:3, :3] = np.array([[np.sin(yaw), 0, np.cos(yaw)], [-np.cos(yaw), 0, np.sin(yaw)], [0, -1, 0]])
        poses.append(T)
    rows = [camera_row(k, T) for k, T in enumerate(poses)]
    np.testing.assert_allclose(load(rows).mean_up, [0, 0, 1], atol=1e-12)


def test_cameras_that_look_every_way_have_no_up(load):
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, 1, 1] = T[1, 0, 0] = -1
    assert load([camera_row(k, pose) for k, pose in enumerate(T)]).mean_up is None
    assert load([]).mean_up is None


GOOD = camera_row(0, np.eye(4))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "cannot be read"),
        ("[" * 100_000, "cannot be read"),
        ('"\ud800"'.encode("utf-8", "surrogatepass"), "cannot be read|not a list"),
        ("{}", "not a list"),
        ("[1]", "broken camera"),
        (json.dumps([{**GOOD, "rotation": [[1, 0], [0, 1]]}]), "broken camera"),
        (json.dumps([{**GOOD, "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}]), "rotation is none"),
        (json.dumps([{**GOOD, "rotation": [[2, 0, 0], [0, 2, 0], [0, 0, 2]]}]), "rotation is none"),
        (json.dumps([{**GOOD, "position": [1, 2, float("nan")]}]), "finite"),
        (json.dumps([{**GOOD, "width": 0}]), "positive"),
        (json.dumps([{**GOOD, "width": 10**40}]), "more than 64 bits"),
        (json.dumps([{**GOOD, "fx": "wide"}]), "broken camera"),
        (json.dumps([{key: value for key, value in GOOD.items() if key != "fy"}]), "'fy'"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "cameras.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SceneError, match=message) as refusal:
        load_views(path)
    assert "\n" not in str(refusal.value)


def test_missing_and_huge_files_are_refused(tmp_path):
    with pytest.raises(SceneError, match="No such file"):
        load_views(tmp_path / "cameras.json")
    with (tmp_path / "huge.json").open("wb") as file:
        file.truncate(10**9)
    with pytest.raises(SceneError, match="more than the 67108864 that are read"):
        load_views(tmp_path / "huge.json")


def test_shapes_that_disagree_are_refused():
    with pytest.raises(ValueError, match="K_px"):
        CapturedViews(images=("a",), sizes_px=np.ones((1, 2), np.int64), K_px=np.eye(3), T_world_camera=np.eye(4)[None])


def test_some_cameras_are_chosen_in_an_order(file):
    views = load_views(file)
    some = views.select([2, 0])
    assert some.images == (views.images[2], views.images[0])
    np.testing.assert_array_equal(some.sizes_px, views.sizes_px[[2, 0]])
    np.testing.assert_array_equal(some.K_px, views.K_px[[2, 0]])
    np.testing.assert_array_equal(some.T_world_camera, views.T_world_camera[[2, 0]])
