"""A video from a tripod becomes footage; one from a moving camera, and what does not fit it, is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.common.avatars import Avatar
from readygo.common.errors import AvatarError, ConfigError, SceneError
from readygo.services.reconstructor.avatars import complete
from readygo.services.reconstructor.avatars.complete import PersonNetworks, complete_footage
from readygo.services.reconstructor.avatars.config import AvatarFitConfig, FixedCameraConfig
from readygo.services.reconstructor.avatars.fixed_camera import K_of_video, fixed_views, footage_of_video
from readygo.services.reconstructor.avatars.footage import Footage, read_footage
from readygo.services.reconstructor.stages import Stages
from tests.services.reconstructor.avatars.networks import write_brightness
from tests.services.reconstructor.frames.test_video import film

FRAMES, SIDE = 16, 96
CAMERA = FixedCameraConfig(intrinsics="144 144 48 48", height_m=1.35, rate_hz=10.0)


@pytest.fixture(scope="module")
def tripod(tmp_path_factory: pytest.TempPathFactory, coarse_body: Avatar) -> Path:
    """A video of 20 frames a second, with masks and poses of all frames beside it, and keypoints in `other`."""
    folder, place = tmp_path_factory.mktemp("tripod"), "readygo.apps.avatar.capture._SWAY_M"
    config = AvatarCaptureConfig(motion="turn", frames=FRAMES, width_px=SIDE, height_px=SIDE, layout="plain")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place, 0.0)
        capture_avatar(coarse_body, folder / "footage", config, lambda _: None)
        capture_avatar(coarse_body, folder / "other", replace(config, body="keypoints"), lambda _: None)
    writer = cv2.VideoWriter(str(folder / "v.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 20.0, (SIDE, SIDE))
    for path in sorted((folder / "footage" / "images").iterdir()):
        writer.write(cv2.imread(str(path)))
    writer.release()
    (folder / "masks").mkdir()
    for path in sorted((folder / "footage" / "masks").iterdir()):
        shutil.copy(path, folder / "masks" / f"{int(path.stem):06d}.png")
    shutil.copy(folder / "footage" / "poses.npz", folder / "poses.npz")
    return folder


@pytest.fixture
def own_tripod(tripod: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(tripod, tmp_path / "own"))


def footage_of(video: Path, work: Path, camera: FixedCameraConfig = CAMERA) -> Footage:
    stages = Stages(work, lambda _: None)
    with stages.alone():
        return read_footage(footage_of_video(video, stages, camera)[0])


def test_frames_have_their_masks_and_poses_and_one_camera(tripod: Path, tmp_path: Path) -> None:
    truth = np.load(tripod / "footage" / "truth.npz")
    forward = truth["T_world_camera"][0, :3, 2]
    tilt_deg = float(np.rad2deg(np.arcsin(-forward[2])))
    footage = footage_of(tripod / "v.mp4", tmp_path / "work", replace(CAMERA, tilt_deg=tilt_deg))
    every = read_footage(tripod / "footage")
    assert footage.names == tuple(f"{number:06d}.jpg" for number in range(0, FRAMES, 2))
    np.testing.assert_allclose(footage.K_px, every.K_px[::2])
    np.testing.assert_allclose(footage.pose_axis_angle, every.pose_axis_angle[::2], atol=1e-6)
    for found, given in zip(footage.masks, every.masks[::2], strict=True):
        assert found.read_bytes() == given.read_bytes()
    # Heights are those of the truth; the frame of the floor is another one.
    T = footage.T_world_camera
    assert np.ptp(T, axis=0).max() == 0.0
    assert T[0, 2, 3] == pytest.approx(truth["T_world_camera"][0, 2, 3])
    np.testing.assert_allclose(T[0, 2, :3], truth["T_world_camera"][0, 2, :3], atol=1e-6)


def test_axes_of_a_level_camera() -> None:
    views = fixed_views(("a",), np.eye(3), (4, 3), FixedCameraConfig(height_m=2.0))
    np.testing.assert_allclose(views.T_world_camera[0], [[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 2], [0, 0, 0, 1]])


def test_footage_is_made_once_and_again_after_a_change(own_tripod: Path, tmp_path: Path) -> None:
    work = tmp_path / "work"
    footage_of(own_tripod / "v.mp4", work)
    before = (work / "video" / "cameras.json").stat().st_mtime_ns
    footage_of(own_tripod / "v.mp4", work)
    assert (work / "video" / "cameras.json").stat().st_mtime_ns == before
    footage_of(own_tripod / "v.mp4", work, replace(CAMERA, height_m=1.5))
    cameras = json.loads((work / "video" / "cameras.json").read_text())
    assert {row["position"][2] for row in cameras} == {1.5}


def test_lens_of_phones_is_assumed_in_a_note(tripod: Path, tmp_path: Path) -> None:
    assert K_of_video({"size_px": [1920, 1080], "turned_deg": 0}, FixedCameraConfig())[0, 0] == pytest.approx(
        1324, abs=2
    )
    stages = Stages(tmp_path / "work", lambda _: None)
    with stages.alone():
        _, notes = footage_of_video(tripod / "v.mp4", stages, replace(CAMERA, intrinsics=""))
    assert notes[0].startswith("no --intrinsics: a lens of 26 mm")
    assert "1.35 m above the floor" in notes[1]


def test_keypoints_are_those_of_the_frames(own_tripod: Path, tmp_path: Path) -> None:
    rows = np.load(own_tripod / "other" / "keypoints.npz")["keypoints"]
    (own_tripod / "poses.npz").unlink()
    stages = Stages(tmp_path / "work", lambda _: None)
    named = {"keypoints": rows, "images": np.array([f"{number:06d}.jpg" for number in range(FRAMES)])}
    for given in ({"keypoints": rows}, {"keypoints": rows[::2]}, named):
        np.savez(own_tripod / "keypoints.npz", **given)
        with stages.alone():
            folder, _ = footage_of_video(own_tripod / "v.mp4", Stages(stages.folder, lambda _: None), CAMERA)
        found = dict(np.load(folder / "keypoints.npz"))
        chosen = [list(found["images"]).index(f"{number:06d}.jpg") for number in range(0, FRAMES, 2)]
        np.testing.assert_array_equal(found["keypoints"][chosen], rows[::2])
    np.savez(own_tripod / "keypoints.npz", keypoints=rows[:-3])
    with stages.alone(), pytest.raises(AvatarError, match="has 13 rows; the video has 16 frames, and 8 of them"):
        footage_of_video(own_tripod / "v.mp4", Stages(stages.folder, lambda _: None), CAMERA)


def test_masks_of_a_video_are_found_by_a_network(
    own_tripod: Path, coarse_body: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(own_tripod / "masks")
    networks = PersonNetworks(mask=write_brightness(tmp_path / "mask.onnx", (SIDE, SIDE), 0.0, 1.0))
    stages = Stages(tmp_path / "work", lambda _: None)
    config = AvatarFitConfig(camera=CAMERA)
    with stages.alone():
        found = complete_footage(own_tripod / "v.mp4", stages, networks, {coarse_body.name: coarse_body}, config)
    assert [mask.name for mask in found.footage.masks] == [f"{name}.png" for name in found.footage.names]
    assert "above the floor" in found.notes[0]
    assert sorted(path.name for path in stages.folder.iterdir() if path.is_dir()) == ["masks", "video"]
    assert set(complete.STAGE_FOLDERS) >= {"masks", "video"}


def test_videos_that_cannot_be_used_are_one_line_and_leave_nothing(own_tripod: Path, tmp_path: Path) -> None:
    work = tmp_path / "work"
    film(own_tripod / "moves.mp4", frames=40, step_px=4)
    film(own_tripod / "short.mp4", frames=5, step_px=0)
    (own_tripod / "broken.mp4").write_bytes(b"no video")
    (own_tripod / "masks" / "000004.png").unlink()
    square = replace(CAMERA, intrinsics="")
    for name, camera, kind, words in (
        ("moves.mp4", square, AvatarError, r"camera of moves\.mp4 moves: .*`readygo reconstruct .*moves\.mp4`"),
        ("short.mp4", square, AvatarError, r"short\.mp4 has 5 frames; film the person"),
        ("broken.mp4", square, SceneError, "cannot be read as a video"),
        ("v.mp4", CAMERA, AvatarError, r"masks lacks 1 of 8 files, 000004\.png"),
        ("v.mp4", replace(CAMERA, intrinsics="99 99 48 48 0.1 0 0 0"), ConfigError, "have distortion: undistort"),
    ):
        with pytest.raises(kind, match=words):
            footage_of(own_tripod / name, work, camera)
        assert not work.exists()
    with pytest.raises(AvatarError, match=r"poses\.npz has 16 rows; the video has 40 frames"):
        footage_of(own_tripod / "moves.mp4", work, replace(square, check_still=False))


def test_long_videos_have_too_low_a_rate(own_tripod: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.services.reconstructor.avatars.fixed_camera.FRAMES_MAX", 8)
    film(own_tripod / "long.mp4", frames=40, step_px=0)
    with pytest.raises(AvatarError, match=r"long\.mp4 gives 2\.0 frames a second, 9 are needed"):
        footage_of(own_tripod / "long.mp4", tmp_path / "work", FixedCameraConfig())
