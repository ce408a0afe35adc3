import json

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_axis_angle
from readygo.common.gaussians import R_from_up, concatenate, save_ply, transform_cloud
from readygo.common.maps import MapConfig
from readygo.common.robot import RobotConfig
from readygo.common.scenes import import_scene, save_scene
from readygo.common.scenes.filmed import FILMED_MIN
from readygo.common.scenes.scene import verify_scene
from tests.common.gaussians.other_formats import camera_row
from tests.common.maps.room import box, room, sheet
from tests.common.scenes.small_room import cameras, small_room


def test_bundle_holds_gaussians_maps_report_and_nothing_else(scene):
    files = sorted(p.relative_to(scene.path).as_posix() for p in scene.path.rglob("*") if p.is_file())
    maps = ["maps/floor_height_m.npy", "maps/human.png", "maps/human.yaml", "maps/robot.png", "maps/robot.yaml"]
    assert files == [*maps, "report.json", "scene.ply", "scene.toml", "sky.ply"]
    assert [p.name for p in scene.path.parent.iterdir()] == ["small"]


def test_content_hash_depends_on_content_and_not_on_name_or_folder(scene, tmp_path):
    sky = sheet((-50, -50, -5), (100, 0, 0), (0, 100, 0), spacing_m=10)
    same = save_scene(small_room(), sky, tmp_path / "other", name="another", license="none")
    assert same.content_hash == scene.content_hash
    assert save_scene(small_room(), None, tmp_path / "no_sky").content_hash != scene.content_hash
    low = MapConfig(robot_height_m=0.3)
    assert save_scene(small_room(), sky, tmp_path / "low", map_config=low).content_hash != scene.content_hash


def test_import_turns_scales_and_moves_the_file_and_its_sky(tmp_path):
    R_file_world = matrix_from_axis_angle([np.pi / 2, 0, 0])
    in_file = transform_cloud(small_room(), R_file_world, (0, 0, 0), 0.5)
    save_ply(in_file, tmp_path / "a.ply")
    imported = import_scene(
        tmp_path / "a.ply", tmp_path / "out", sky=tmp_path / "a.ply", up="-y", scale=2.0, translate_m=(1.0, 2.0, 3.0)
    )
    np.testing.assert_allclose(imported.cloud.means_m, small_room().means_m + np.float32([1, 2, 3]), atol=1e-5)
    np.testing.assert_array_equal(imported.sky.means_m, imported.cloud.means_m)
    source = imported.metadata["source"]
    assert (source["file"], source["up"], source["scale"]) == ("a.ply", "-y", 2.0)
    assert source["translate_m"] == [1.0, 2.0, 3.0]
    assert len(source["sha256"]) == 64
    assert imported.maps.floor.at(3.0, 4.0) == pytest.approx(3.0, abs=0.01)


def test_robot_height_shapes_the_robot_map(tmp_path):
    cloud = concatenate([room(4.0, 3.0), box((1.5, 1, 0.72), (2.5, 2, 0.76))])
    save_ply(cloud, tmp_path / "a.ply")
    low = import_scene(tmp_path / "a.ply", tmp_path / "low")
    tall = import_scene(tmp_path / "a.ply", tmp_path / "tall", robot=RobotConfig(height_m=1.0))
    cell = low.maps.robot.frame.cell(2.0, 1.5)
    assert not low.maps.robot.occupied[cell]
    assert tall.maps.robot.occupied[cell]


def test_refused_import_leaves_nothing_behind(tmp_path):
    save_ply(box((0, 0, 0), (0.5, 0.5, 0.5)), tmp_path / "object.ply")
    save_ply(room(1.6, 1.6), tmp_path / "closet.ply")
    with pytest.raises(SceneError, match="no floor"):
        import_scene(tmp_path / "object.ply", tmp_path / "a")
    with pytest.raises(SceneError, match=r"no free area .* a disc of radius 0.3 m"):
        import_scene(tmp_path / "closet.ply", tmp_path / "b")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["closet.ply", "object.ply"]


def test_failure_while_writing_leaves_nothing_behind(tmp_path, monkeypatch):
    def full_disk(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("readygo.common.scenes.bundle.np.save", full_disk)
    with pytest.raises(SceneError, match="No space left"):
        save_scene(small_room(), None, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_existing_folder_is_not_touched(tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(SceneError, match="exists already"):
        save_scene(small_room(), None, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": 0.0},
        {"scale": float("nan")},
        {"translate_m": (0.0, float("inf"), 0.0)},
        {"up": "north"},
        {"resolution_m": -1.0},
        {"human_height_m": 0.0},
    ],
)
def test_wrong_arguments_are_scene_errors(tmp_path, wrong):
    save_ply(small_room(), tmp_path / "a.ply")
    with pytest.raises(SceneError):
        import_scene(tmp_path / "a.ply", tmp_path / "out", **wrong)


def room_with(**values):
    """A room in which two Gaussians have other numbers, one of them twice over."""
    sound = small_room()
    arrays = {name: getattr(sound, name).copy() for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")}
    for name, value in values.items():
        arrays[name][[10, 20]] = value
    return type(sound)(**arrays)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"means_m": np.nan}, "2 of .*position not finite: 2"),
        ({"means_m": 2e4}, "2 of .*position beyond 10000 m: 2"),
        ({"scales_m": 2e4}, "2 of .*scale above 10000 m: 2"),
        ({"scales_m": np.inf, "sh": 200.0}, r"2 of .*scale not finite: 2\)"),
        ({"sh": -200.0}, "2 of .*colour beyond 100: 2"),
    ],
)
def test_gaussians_that_cannot_be_drawn_are_refused_or_dropped_with_their_count(tmp_path, values, message):
    save_ply(room_with(**values), tmp_path / "room.ply")
    with pytest.raises(SceneError, match=message) as caught:
        import_scene(tmp_path / "room.ply", tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert "--drop-bad" in str(caught.value)
    assert not (tmp_path / "out").exists()
    scene = import_scene(tmp_path / "room.ply", tmp_path / "out", drop_bad=True)
    assert scene.metadata["source"]["dropped_gaussians"] == 2
    kept = np.delete(small_room().means_m, [10, 20], axis=0)
    np.testing.assert_allclose(scene.cloud.means_m, kept, atol=1e-6)


def test_defects_are_judged_in_metres_and_in_the_sky_too(tmp_path):
    save_ply(small_room(), tmp_path / "room.ply")
    save_ply(room_with(means_m=2e4), tmp_path / "sky.ply")
    with pytest.raises(SceneError, match=r"sky\.ply has 2 of"):
        import_scene(tmp_path / "room.ply", tmp_path / "out", sky=tmp_path / "sky.ply")
    save_ply(transform_cloud(room_with(means_m=2e4), np.eye(3), scale=2.0), tmp_path / "double.ply")
    scene = import_scene(tmp_path / "double.ply", tmp_path / "half", scale=0.5, drop_bad=True)
    assert scene.metadata["source"]["dropped_gaussians"] == 2


def test_scene_of_sound_gaussians_drops_none_whatever_is_asked(tmp_path):
    save_ply(small_room(), tmp_path / "room.ply")
    scene = import_scene(tmp_path / "room.ply", tmp_path / "out", drop_bad=True)
    assert scene.metadata["source"]["dropped_gaussians"] == 0
    assert len(scene.cloud) == len(small_room())


def test_file_without_a_sound_gaussian_is_refused_even_when_bad_ones_may_be_dropped(tmp_path):
    bad = room_with()
    bad.means_m[:] = np.nan
    save_ply(bad, tmp_path / "room.ply")
    with pytest.raises(SceneError, match="cannot be drawn"):
        import_scene(tmp_path / "room.ply", tmp_path / "out", drop_bad=True)


def test_cameras_of_an_output_folder_come_along_and_say_which_way_is_up(tmp_path):
    R_world_file = R_from_up("0.1,-0.95,0.2")
    place = tmp_path / "lobby" / "point_cloud" / "iteration_30000"
    place.mkdir(parents=True)
    save_ply(transform_cloud(small_room(), R_world_file.T, (0, 0, 0), 0.5), place / "point_cloud.ply")
    level = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    T_world_camera = np.tile(np.eye(4), (3, 1, 1))
    T_world_camera[:, :3, :3] = level
    T_world_camera[:, :3, 3] = [[1, 1, 1], [2, 1, 1.2], [3, 2, 1]]
    in_file = T_world_camera.copy()
    in_file[:, :3, :3] = R_world_file.T @ level
    in_file[:, :3, 3] = 0.5 * T_world_camera[:, :3, 3] @ R_world_file
    rows = [camera_row(k, T) for k, T in enumerate(in_file)]
    (tmp_path / "lobby" / "cameras.json").write_text(json.dumps(rows))
    scene = import_scene(tmp_path / "lobby", tmp_path / "out", up="cameras", scale=2.0)
    np.testing.assert_allclose(scene.cloud.means_m, small_room().means_m, atol=1e-3)
    np.testing.assert_allclose(scene.views.T_world_camera, T_world_camera, atol=1e-3)
    assert scene.metadata["source"]["file"] == "lobby/point_cloud/iteration_30000/point_cloud.ply"
    assert scene.metadata["source"]["kind"] == ".ply"
    verify_scene(scene)
    assert save_scene(scene.cloud, None, tmp_path / "again").content_hash == scene.content_hash


def test_scene_without_cameras_has_no_views_and_no_up_of_them(scene, tmp_path):
    assert scene.views is None
    save_ply(small_room(), tmp_path / "a.ply")
    with pytest.raises(SceneError, match="without cameras"):
        import_scene(tmp_path / "a.ply", tmp_path / "out", up="cameras")


def test_robot_stays_where_it_sees_what_was_filmed(tmp_path):
    views = cameras()
    plain = save_scene(small_room(), None, tmp_path / "plain")
    filmed = save_scene(small_room(), None, tmp_path / "filmed", views=views)
    elsewhere = save_scene(
        small_room(), None, tmp_path / "elsewhere", views=views.transform(np.eye(3), (40.0, 0.0, 0.0))
    )
    open_config = MapConfig(close_unfilmed=False)
    kept = save_scene(small_room(), None, tmp_path / "kept", views=views, map_config=open_config)
    verify_scene(filmed)
    assert plain.maps.filmed_share is None
    share = filmed.maps.filmed_share
    assert share is not None
    free = ~plain.maps.robot.occupied
    np.testing.assert_array_equal(~filmed.maps.robot.occupied, free & (share >= FILMED_MIN))
    np.testing.assert_array_equal(filmed.maps.human.occupied, plain.maps.human.occupied)
    np.testing.assert_array_equal(kept.maps.robot.occupied, plain.maps.robot.occupied)
    np.testing.assert_array_equal(elsewhere.maps.robot.occupied, plain.maps.robot.occupied)
    assert kept.content_hash == plain.content_hash


def test_report_of_a_reconstruction_stays_with_the_scene(scene, tmp_path):
    made = save_scene(small_room(), None, tmp_path / "made", reconstruction={"scale": {"interval_percent": 0.2}})
    assert made.reconstruction == {"scale": {"interval_percent": 0.2}}
    assert scene.reconstruction is None
