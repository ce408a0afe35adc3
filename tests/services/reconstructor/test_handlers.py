from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest

from readygo.common.camera.captured import CapturedViews
from readygo.common.drawing.files import write_png
from readygo.common.errors import ConfigError, SceneError
from readygo.common.scenes import save_scene
from readygo.common.scenes.export import export_scene
from readygo.services.reconstructor import handlers
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.panorama import cut_panoramas, panorama_rays, view_rotations
from readygo.services.reconstructor.frames.video import write_jpeg
from readygo.services.reconstructor.given import depth
from readygo.services.reconstructor.handlers import (
    _depth_numbers,
    _name_pairs,
    adjusted_as,
    device_of,
    find_poses,
    known_lengths,
    known_lens,
    make_frames,
    make_markers,
)
from readygo.services.reconstructor.job import images_of, open_source
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.poses.colmap import pinhole_views
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.depths import DepthRatio
from readygo.services.reconstructor.similarity import umeyama
from readygo.services.reconstructor.stages import StageProgress
from readygo.services.reconstructor.training.measured import points_of_depths
from readygo.services.reconstructor.training.photos import open_posed
from tests.common.scenes.small_room import small_room
from tests.services.reconstructor.given import test_find, test_polycam
from tests.services.reconstructor.given.test_depth import png
from tests.services.reconstructor.given.test_transforms import FRAMES, LENS, written
from tests.services.reconstructor.synthetic import photos
from tests.services.reconstructor.test_job import colmap_source


def test_work_without_a_scale_does_not_begin(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        find_poses(photos(tmp_path / "p", 4), tmp_path / "out", ReconstructorConfig(), print)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("length", "words", "stages"),
    [
        ("a.jpg:1,2 a.jpg:3 = 1", "is no pick", []),
        ("0.jpg:1,2 0.jpg:3,4 9.jpg:1,2 9.jpg:3,4 = 1", r"9\.jpg, which is no image here", ["frames"]),
    ],
)
def test_lengths_that_cannot_be_are_refused_before_the_poses(
    tmp_path: Path, length: str, words: str, stages: list[str]
) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    config, said = ReconstructorConfig(metric=MetricConfig(lengths=(length,))), list[str]()
    with pytest.raises(ConfigError, match=words):
        find_poses(photos(tmp_path / "p", 3), tmp_path / "out", config, lambda progress: said.append(progress.stage))
    assert said == stages


def test_images_without_markers_are_refused(tmp_path: Path) -> None:
    config = ReconstructorConfig(metric=MetricConfig(marker_size_m=0.2))
    frames = {"names": ["0.jpg", "1.jpg"]}
    with pytest.raises(SceneError, match=r"No image shows a marker of 4X4_50.*--metric.marker-dictionary"):
        make_markers(photos(tmp_path / "p", 2), frames, config, tmp_path)


def test_photos_without_texture_end_with_advice_and_keep_what_is_done(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), frames=FramesConfig(side_max_px=320))
    said: list[str] = []

    def hear(progress: StageProgress) -> None:
        said.append(progress.stage)

    for _ in range(2):
        with pytest.raises(SceneError, match=r"0 of 3 images found a pose.*Film again"):
            find_poses(photos(tmp_path / "p", 3) if not said else tmp_path / "p", tmp_path / "out", config, hear)
    assert said == ["frames", "features", "matches", "map", "map"]
    assert not (tmp_path / "out" / "map").exists()


def test_given_lens_is_fitted_to_the_images_and_needs_one_size(tmp_path: Path) -> None:
    config = ReconstructorConfig(poses=PosesConfig(intrinsics="1000 1000 500 400"))
    assert known_lens({}, ReconstructorConfig()) is None
    found = known_lens({"source_px": [1000, 800], "size_px": [500, 400]}, config)
    assert found is not None
    assert found.params[:4] == (500.0, 500.0, 250.0, 200.0)
    with pytest.raises(ConfigError, match="images of one size"):
        known_lens({"source_px": None, "size_px": [[500, 400], [400, 500]]}, config)


def test_lens_of_a_map_is_fixed_where_it_came_with_the_poses_or_was_given() -> None:
    assert adjusted_as({"pose": {}}, PosesConfig()).fixes_lens
    assert adjusted_as({}, PosesConfig(intrinsics="lens.yml")).fixes_lens
    assert not adjusted_as({}, PosesConfig()).fixes_lens


def test_lens_of_other_images_is_refused_before_the_features(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    poses, said = PosesConfig(intrinsics="1000 1000 960 540"), list[str]()
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=poses)
    with pytest.raises(ConfigError, match="not near the middle of images of 80x60 px"):
        find_poses(photos(tmp_path / "p", 3), tmp_path / "out", config, lambda progress: said.append(progress.stage))
    assert said == ["frames"]
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=PosesConfig(intrinsics="1 2 3"))
    with pytest.raises(ConfigError, match="3 numbers"):
        find_poses(tmp_path / "p", tmp_path / "other", config, print)
    assert not (tmp_path / "other").exists()


def test_captures_with_poses_need_a_scale_unless_their_device_measured_it(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    said: list[str] = []

    def hear(progress: StageProgress) -> None:
        said.append(progress.stage)

    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        find_poses(test_find.transforms(tmp_path / "t"), tmp_path / "out", ReconstructorConfig(), hear)
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=PosesConfig(intrinsics="9 9 4 3"))
    with pytest.raises(ConfigError, match="comes with its lenses; leave --intrinsics out"):
        find_poses(tmp_path / "t", tmp_path / "out", config, hear)
    assert said == []
    with pytest.raises(SceneError, match="Film again"):
        find_poses(test_polycam.export(tmp_path / "p"), tmp_path / "out", ReconstructorConfig(), hear)
    assert said == ["frames", "features", "matches", "map"], "grey images share nothing"


def test_depths_that_cannot_be_read_tell_no_scale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [{**frame, "depth_file_path": f"{row}.exr"} for row, frame in enumerate(FRAMES)]
    for row in range(len(frames)):
        (tmp_path / f"{row}.exr").touch()
    written(tmp_path, {**LENS, "frames": frames})
    monkeypatch.setattr(depth, "is_installed", lambda module: False)
    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        find_poses(tmp_path / "transforms.json", tmp_path / "out", ReconstructorConfig(), lambda progress: None)


def test_360_degree_sources_bring_their_lens_and_are_videos_or_photos(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    frames, metric = FramesConfig(projection="equirectangular"), MetricConfig(scale=1.0)
    config = ReconstructorConfig(frames=frames, metric=metric, poses=PosesConfig(intrinsics="9 9 4 3"))
    with pytest.raises(ConfigError, match="360-degree source comes with its lenses; leave --intrinsics out"):
        find_poses(photos(tmp_path / "p", 3), tmp_path / "out", config, print)
    config = ReconstructorConfig(frames=frames, metric=metric)
    with pytest.raises(ConfigError, match="has poses of its images already; --equirectangular is for videos"):
        find_poses(test_find.transforms(tmp_path / "t"), tmp_path / "out", config, print)
    with pytest.raises(SceneError, match="Images of 80x60 px are no 360-degree images"):
        find_poses(tmp_path / "p", tmp_path / "out", config, lambda progress: None)
    assert not (tmp_path / "out" / "frames").exists()


def test_images_that_may_show_360_degrees_are_named_and_cut_where_asked(tmp_path: Path) -> None:
    (tmp_path / "p").mkdir()
    for name in "abc":
        write_jpeg(tmp_path / "p" / f"{name}.jpg", np.full((64, 128, 3), 90, np.uint8))
    found = make_frames(open_source(tmp_path / "p"), ReconstructorConfig(), tmp_path / "plain")
    assert "if they show 360 degrees, give --equirectangular" in found["notes"][0]
    config = ReconstructorConfig(frames=FramesConfig(projection="equirectangular"))
    found = make_frames(open_source(tmp_path / "p"), config, tmp_path / "views")
    assert found["names"][:4] == ["view_0/a.jpg", "view_0/b.jpg", "view_0/c.jpg", "view_1/a.jpg"]
    assert len(found["names"]) == found["kept"] == 24
    assert found["size_px"] == [40, 40]


def room(centre_m: np.ndarray, width_px: int) -> np.ndarray:
    """A 360-degree image in a room of 4 m x 3 m x 5 m with noise on its walls."""
    rng = np.random.default_rng(0)
    walls = [cv2.resize(rng.integers(0, 255, (40, 40, 3), dtype=np.uint8), (800, 800)) for _ in range(6)]
    half_m, rays = np.array([2.0, 1.5, 2.5]), panorama_rays(width_px)
    with np.errstate(divide="ignore"):
        ahead = np.where(rays > 0, half_m - centre_m, -half_m - centre_m) / rays
    axis = np.argmin(ahead, axis=-1)
    share = (centre_m + rays * ahead.min(axis=-1)[..., None]) / half_m
    image = np.zeros((*axis.shape, 3), np.uint8)
    for number, wall in enumerate(walls):
        on = (axis == number // 2) & ((np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0) == number % 2)
        u, v = (np.delete(share[on], number // 2, axis=1).T * 399 + 400).astype(int)
        image[on] = wall[v.clip(0, 799), u.clip(0, 799)]
    return image


@pytest.mark.slow
def test_views_of_360_degree_photos_get_poses_about_the_centres_of_their_photos(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    centres_m = np.array([[0.0, 0.0, -0.4], [0.4, 0.1, 0.1], [-0.3, -0.1, 0.4]])
    (tmp_path / "p").mkdir()
    for number, centre_m in enumerate(centres_m):
        write_jpeg(tmp_path / "p" / f"{number}.jpg", cv2.resize(room(centre_m, 1536), (768, 384), None, 0, 0, 3))
    config = ReconstructorConfig(
        frames=FramesConfig(projection="equirectangular"),
        metric=MetricConfig(scale=1.0),
        poses=PosesConfig(threads=1),
    )
    report = find_poses(tmp_path / "p", tmp_path / "out", config, lambda progress: None)
    assert report["verdict"]["registered"] == 24
    views = pinhole_views(tmp_path / "out" / "posed" / "sparse" / "0")
    found = {name: T for name, T in zip(views.images, views.T_world_camera, strict=True)}
    rig = view_rotations()
    T = np.array([found[f"view_0/{number}.jpg"] for number in range(3)])
    for name, R in rig.items():
        for number in range(3):
            np.testing.assert_allclose(found[f"{name}/{number}.jpg"][:3, 3], T[number, :3, 3], atol=1e-6)
            np.testing.assert_allclose(found[f"{name}/{number}.jpg"][:3, :3], T[number, :3, :3] @ R, atol=1e-6)
    fitted = umeyama(T[:, :3, 3], centres_m)
    np.testing.assert_allclose(fitted.apply(T[:, :3, 3]), centres_m, atol=0.01)
    turns = np.degrees(np.arccos(((np.trace(fitted.R @ T[:, :3, :3], axis1=1, axis2=2) - 1) / 2).clip(-1, 1)))
    assert turns.max() < 0.3


def write_room_shots(folder: Path) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Four views of 244 px of `room` in `folder`/images; names, poses and intrinsics."""
    centres_m = np.array([[-0.6, 0.0, 0.0], [-0.2, 0.2, 0.1], [0.2, -0.2, -0.1], [0.6, 0.1, 0.2]])
    for number, centre_m in enumerate(centres_m):
        panorama = cv2.resize(room(centre_m, 1536), (768, 384), None, 0, 0, cv2.INTER_AREA)
        write_jpeg(folder / "images" / f"{number}.jpg", panorama)
    cut_panoramas(folder / "images", {"size_px": [768, 384]})
    names, T = tuple(f"view_0/{number}.jpg" for number in range(4)), np.tile(np.eye(4), (4, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], centres_m[:, [0, 2, 1]] * (1, 1, -1)
    return names, T, np.tile([[122.0, 0, 122.0], [0, 122.0, 122.0], [0, 0, 1]], (4, 1, 1))


@pytest.mark.parametrize("kind", ["colmap", "transforms"])
def test_exported_cameras_come_back_with_their_poses_and_lenses(
    tmp_path: Path, kind: Literal["colmap", "transforms"]
) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    names, T, K = write_room_shots(tmp_path)
    views = CapturedViews(images=names, sizes_px=np.full((4, 2), 244), K_px=K, T_world_camera=T)
    scene = save_scene(small_room(), None, tmp_path / "room", views=views)
    export_scene(scene, kind, tmp_path / "out", tmp_path / "images")
    config = ReconstructorConfig(metric=MetricConfig(scale=1.0), poses=PosesConfig(threads=1))
    report = find_poses(tmp_path / "out", tmp_path / "again", config, lambda progress: None)
    assert report["verdict"]["registered"] == 4
    again = pinhole_views(tmp_path / "again" / "posed" / "sparse" / "0")
    np.testing.assert_allclose(again.K_px, K, atol=1e-6)
    order = [again.images.index(Path(name).name) for name in names]
    moved = np.linalg.inv(again.T_world_camera[order[0]]) @ again.T_world_camera[order]
    np.testing.assert_allclose(moved, np.linalg.inv(T[0]) @ T, atol=1e-6)


def test_depth_images_tell_the_scale_and_are_moved_with_the_map(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    names, T, _ = write_room_shots(tmp_path)
    rays = np.dstack([*((np.mgrid[:61, :61][::-1] + 0.5) * 4 / 122 - 1), np.ones((61, 61))]) + 1e-9
    frames = []
    for number, name in enumerate(names):
        x, up, ahead = T[number, :3, 3][[0, 2, 1]]
        to_wall_m = np.where(rays > 0, [2, 1.5, 2.5], [-2, -1.5, -2.5]) - [x, -up, ahead]
        depth_m = (to_wall_m / rays).min(axis=2)
        png(tmp_path / "depth" / f"{number}.png", np.rint(1000 * depth_m).astype(np.uint16))
        opengl = T[number] @ np.diag([1.0, -1.0, -1.0, 1.0])
        opengl[:3, 3] *= 0.5
        row = {"file_path": f"images/{name}", "depth_file_path": f"depth/{number}.png"}
        frames.append({**row, "transform_matrix": opengl.tolist()})
    lens = {"fl_x": 122.0, "fl_y": 122.0, "cx": 122.0, "cy": 122.0, "w": 244, "h": 244}
    written(tmp_path, {**lens, "frames": frames})
    config = ReconstructorConfig(poses=PosesConfig(threads=1))
    report = find_poses(tmp_path / "transforms.json", tmp_path / "out", config, lambda progress: None)
    assert report["scale"]["source"] == "the device (depth images of transforms.json)"
    assert report["scale"]["metres_per_unit"] == pytest.approx(2.0, rel=0.01)
    assert report["depth"]["images"] == 4
    assert report["depth"]["longer_than_map"] == pytest.approx(1.0)
    assert any(note.startswith("check: depths of the device are ") for note in report["notes"])
    posed = open_posed(tmp_path / "out" / "posed", tmp_path / "undistorted")
    points_m, _ = points_of_depths(posed, (0, 1, 2, 3), 10_000)
    # Floor and ceiling are 3 m apart, and level.
    heights_m = np.sort(points_m[:, 2])
    assert len(points_m) > 1000
    assert np.median(heights_m[-100:]) - np.median(heights_m[:100]) == pytest.approx(3.0, abs=0.05)
    without = ReconstructorConfig(frames=FramesConfig(depth=False))
    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        find_poses(tmp_path / "transforms.json", tmp_path / "other", without, lambda progress: None)


def test_depths_tell_the_scale_of_poses_that_have_none_and_check_others() -> None:
    ratio = DepthRatio(units_per_metre=0.8, spread=0.02, sightings=90, images=7)
    frames = {"what": "Polycam", "metric": True, "depths": 9}
    assert device_of(frames, ratio).metres_per_unit == 1.0
    assert device_of(frames, ratio).name == "Polycam"
    scaled = device_of({**frames, "metric": False}, ratio)
    assert (scaled.metric, scaled.metres_per_unit, scaled.name) == (True, 1.25, "depth images of Polycam")
    assert not device_of({**frames, "metric": False}).metric
    numbers = _depth_numbers(frames, ratio, 1.0)
    assert (numbers["images"], numbers["sightings"], numbers["longer_than_map"]) == (9, 90, 1.25)
    assert numbers["note"] == "check: depths of the device are +25.0 % longer than those of 90 points in 7 images"
    assert "not used: too few points" in _depth_numbers(frames, None, 1.0)["note"]


def test_names_of_a_colmap_source_are_those_of_its_model_and_masks_are_of_these(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    folder = colmap_source(tmp_path / "m")
    names = ["2.jpg", "10.jpg", "sub/c.jpg"]
    for name in names:
        write_jpeg(folder / "images" / name, np.full((60, 80, 3), 90, np.uint8))
        write_png(tmp_path / "masks" / f"{name}.png", np.full((60, 80, 3), 255, np.uint8))
    config = ReconstructorConfig(frames=FramesConfig(masks=str(tmp_path / "masks")))
    found = make_frames(open_source(folder), config, tmp_path / "frames")
    assert found["names"] == names
    assert images_of(found, tmp_path) == ((folder / "images").resolve(), names)
    assert sorted(path.name for path in (tmp_path / "frames").rglob("*.png")) == [
        "10.jpg.png",
        "2.jpg.png",
        "c.jpg.png",
    ]


def test_images_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    (tmp_path / "p").mkdir()
    for number in (1, 2, 9, 10, 11):
        size = (48, 64) if number % 2 else (64, 48)
        write_jpeg(tmp_path / "p" / f"IMG {number}.jpg", np.full((*size, 3), 90, np.uint8))
    found = make_frames(open_source(tmp_path / "p"), ReconstructorConfig(), tmp_path / "frames")
    assert [Path(name).name for name in found["names"]] == [f"IMG_{number}.jpg" for number in (1, 2, 9, 10, 11)]
    assert set(found["names"]) == {image for image, _ in found["photos"].values()}


def test_neighbours_of_many_images_are_those_of_the_next_numbers() -> None:
    names = [f"{number}.jpg" for number in range(200)]
    pairs = _name_pairs(names, None, "capture", ReconstructorConfig())
    assert ("9.jpg", "10.jpg") in pairs
    views = [f"view_{view}/{number}.jpg" for view in range(2) for number in range(130)]
    rig = {"view_0": np.eye(3), "view_1": np.diag([-1.0, 1.0, -1.0])}
    pairs = _name_pairs(views, rig, "photos", ReconstructorConfig())
    assert ("view_0/9.jpg", "view_0/10.jpg") in pairs
    assert ("view_0/109.jpg", "view_0/11.jpg") not in pairs


def test_lengths_are_told_by_the_names_of_the_photos_with_or_without_spaces() -> None:
    frames = {"names": ["a_1.jpg", "b.jpg"], "photos": {"a 1.png": ("a_1.jpg", 0.5), "b.jpg": ("b.jpg", 1.0)}}
    config = MetricConfig(lengths=("a_1.png:8,4 a_1.png:2,6 b.jpg:8,4 b.jpg:2,6 = 1",))
    (known,) = known_lengths(frames, config)
    assert known.ends[0] == (("a_1.jpg", 4.0, 2.0), ("b.jpg", 8.0, 4.0))


def test_photos_with_spaces_in_their_names_are_matched_and_masked(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    noise = cv2.resize(np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8), (320, 240))
    for name in ("#1 a.jpg", "IMG 2.jpg", "IMG\u202f3.jpg"):
        write_jpeg(tmp_path / "p" / name, noise)
        write_png(tmp_path / "masks" / f"{name}.png", np.full((240, 320, 3), 255, np.uint8))
    frames, metric = FramesConfig(masks=str(tmp_path / "masks")), MetricConfig(scale=1.0)
    config = ReconstructorConfig(frames=frames, metric=metric, poses=PosesConfig(threads=1))
    with pytest.raises(SceneError, match="images found a pose"):
        find_poses(tmp_path / "p", tmp_path / "out", config, lambda progress: None)
    import pycolmap

    with pycolmap.Database.open(tmp_path / "out" / "matches" / "database.db") as db:
        assert {image.name for image in db.read_all_images()} == {"_1_a.jpg", "IMG_2.jpg", "IMG_3.jpg"}
        assert db.num_matched_image_pairs() == 3


def test_images_are_made_again_by_other_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    config, said = ReconstructorConfig(metric=MetricConfig(scale=1.0)), list[str]()
    photos(tmp_path / "p", 3)
    for new in ("", "given", "frames"):
        monkeypatch.setattr(handlers, "code_digest", lambda *of, new=new: str([part == new for part in sorted(of)]))
        with pytest.raises(SceneError, match="Film again"):
            find_poses(tmp_path / "p", tmp_path / "out", config, lambda progress: said.append(progress.stage))
    assert said == ["frames", "features", "matches", "map"] * 3
