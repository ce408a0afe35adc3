"""What footage lacks is found once, and kept; what is given is used; what cannot be found is named."""

import dataclasses
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.common.avatars import Avatar
from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars import complete
from readygo.services.reconstructor.avatars.complete import CompleteFootage, PersonNetworks, complete_footage
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.detectors import box_of_mask
from readygo.services.reconstructor.avatars.footage import mask_files, read_views, write_poses
from readygo.services.reconstructor.avatars.keypoints import KEYPOINTS_FILE, read_keypoints
from readygo.services.reconstructor.avatars.views import PersonMask, read_masks
from readygo.services.reconstructor.stages import Stages
from tests.services.reconstructor.avatars.networks import write_brightness, write_points

SIZE = 256, 192


@pytest.fixture(scope="module")
def keypoint_film(tmp_path_factory: pytest.TempPathFactory, coarse_body: Avatar) -> Path:
    folder = tmp_path_factory.mktemp("film") / "keypoints"
    config = AvatarCaptureConfig(
        motion="turn", frames=12, width_px=96, height_px=96, layout="plain", body="keypoints", keypoint_noise_px=0.5
    )
    capture_avatar(coarse_body, folder, config, lambda _: None)
    return folder


@pytest.fixture(autouse=True)
def short_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits that end early: how well they fit is tested elsewhere."""
    monkeypatch.setattr("readygo.services.reconstructor.avatars.keypoint_poses._STAGES", ((3.0, 25), (1.0, 5)))


@pytest.fixture
def own_film(keypoint_film: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(keypoint_film, tmp_path / "own"))


def _complete(
    film: Path, work: Path, body: Avatar, networks: PersonNetworks | None = None, heard: list[str] | None = None
) -> CompleteFootage:
    stages = Stages(work, lambda progress: heard.append(progress.stage) if heard is not None else None)
    with stages.alone():
        return complete_footage(film, stages, networks or PersonNetworks(), {body.name: body}, AvatarFitConfig())


def test_poses_are_found_from_keypoints_once(keypoint_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    heard: list[str] = []
    first = _complete(keypoint_film, tmp_path / "work", coarse_body, heard=heard)
    again = _complete(keypoint_film, tmp_path / "work", coarse_body, heard=heard)
    assert heard == ["poses"]
    np.testing.assert_array_equal(first.footage.pose_axis_angle, again.footage.pose_axis_angle)
    longer = dataclasses.replace(coarse_body, joints_tpose_m=coarse_body.joints_tpose_m * np.float32(1.05))
    _complete(keypoint_film, tmp_path / "work", longer, heard=heard)
    assert heard == ["poses", "poses"], "of other bodies they are others"
    assert first.poses_found
    truth = np.load(keypoint_film / "truth.npz")
    assert np.linalg.norm(first.footage.root_m - truth["root_m"], axis=1).mean() < 0.2


def test_given_poses_are_used(plain_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    networks = PersonNetworks(keypoints=Path("nowhere.onnx"), mask=Path("nowhere.onnx"))
    found = _complete(plain_film, tmp_path / "work", coarse_body, networks)
    assert not found.poses_found
    assert [note.split(":")[0] for note in found.notes] == [
        "the network for masks is not used", "the network for keypoints is not used",
    ]  # fmt: skip
    assert not (tmp_path / "work").exists()


def test_masks_and_keypoints_of_networks_are_kept(own_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    views = read_views(own_film)
    masks, _ = read_masks(mask_files(own_film / "masks", views.images), views.sizes_px)
    keypoints = read_keypoints(own_film / KEYPOINTS_FILE, views.images)
    left, top, width, _ = box_of_mask(masks[0].whole(), SIZE[1] / SIZE[0])
    points = np.clip((keypoints.uv_px[0] - (left, top)) * (SIZE[1] / width), 0.0, (SIZE[1] - 1, SIZE[0] - 1))
    networks = PersonNetworks(keypoints=write_points(tmp_path / "keypoints.onnx", SIZE, points))
    (own_film / KEYPOINTS_FILE).unlink()
    heard: list[str] = []
    _complete(own_film, tmp_path / "work", coarse_body, networks, heard)
    _complete(own_film, tmp_path / "work", coarse_body, networks, heard)
    assert heard == ["keypoints", "poses"]
    for changed in (own_film / "images" / views.images[0], own_film / "masks" / views.images[0]):
        os.utime(changed, ns=(0, 0))
        heard.clear()
        _complete(own_film, tmp_path / "work", coarse_body, networks, heard)
        assert heard[0] == "keypoints"
    found = read_keypoints(tmp_path / "work" / "keypoints" / KEYPOINTS_FILE, views.images)
    inside = (keypoints.uv_px[0] >= 0.0).all(axis=1)
    assert np.abs(found.uv_px[0] - keypoints.uv_px[0])[inside].max() < 1.5


def test_masks_of_a_network_take_their_place(
    own_film: Path, coarse_body: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(own_film / "masks")
    network = write_brightness(tmp_path / "mask.onnx", (96, 96), 0.0, 1.0)
    monkeypatch.setattr(complete, "check_keypoints", lambda *_: [])
    monkeypatch.setattr(complete, "read_masks", lambda paths, _: ([], []))
    found = _complete(own_film, tmp_path / "work", coarse_body, PersonNetworks(mask=network))
    assert [mask.name for mask in found.footage.masks] == [f"{name}.png" for name in found.footage.names]
    assert found.footage.masks[0].parent == tmp_path / "work" / "masks"


def test_what_cannot_be_found_is_named_and_leaves_nothing(own_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    work = tmp_path / "work"
    shutil.move(own_film / KEYPOINTS_FILE, tmp_path / "kept.npz")
    with pytest.raises(AvatarError, match=r"Network .*nowhere\.onnx is missing"):
        _complete(own_film, work, coarse_body, PersonNetworks(keypoints=Path("nowhere.onnx")))
    with pytest.raises(AvatarError, match=r"has no poses: .* nor keypoints"):
        _complete(own_film, work, coarse_body)
    shutil.move(tmp_path / "kept.npz", own_film / KEYPOINTS_FILE)
    (own_film / "masks" / "00004.png").unlink()
    with pytest.raises(AvatarError, match=r"masks lacks 1 of 12 files, 00004\.png"):
        _complete(own_film, work, coarse_body)
    shutil.rmtree(own_film / "masks")
    with pytest.raises(AvatarError, match=r"has no masks: .*--mask-model"):
        _complete(own_film, work, coarse_body)
    assert not work.exists()


def test_other_settings_find_other_poses(keypoint_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    stages = Stages(tmp_path / "work", lambda _: None)
    config = AvatarFitConfig()
    other = dataclasses.replace(config, prior=dataclasses.replace(config.prior, jerk_deg=0.5))
    found = []
    for each in (config, other):
        with stages.alone():
            found.append(
                complete_footage(
                    keypoint_film,
                    Stages(stages.folder, lambda _: None),
                    PersonNetworks(),
                    {coarse_body.name: coarse_body},
                    each,
                )
            )
    assert not np.array_equal(found[0].footage.pose_axis_angle, found[1].footage.pose_axis_angle)


def test_masks_and_keypoints_are_found_of_images_in_folders(
    own_film: Path, coarse_body: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cameras = json.loads((own_film / "cameras.json").read_text())
    for number, row in enumerate(cameras):
        name = f"view_{number % 2}/{number // 2}.png"
        (own_film / "images" / name).parent.mkdir(exist_ok=True)
        (own_film / "images" / row["img_name"]).rename(own_film / "images" / name)
        row["img_name"] = name
    (own_film / "cameras.json").write_text(json.dumps(cameras))
    shutil.rmtree(own_film / "masks")
    (own_film / KEYPOINTS_FILE).unlink()
    whole = PersonMask.of_whole(np.ones((96, 96), dtype=bool))
    monkeypatch.setattr(complete, "check_keypoints", lambda *_: [])
    monkeypatch.setattr(complete, "read_masks", lambda paths, _: ([whole] * len(paths), []))

    def stand(_keypoints: object, _views: object, stages: Stages, *_: object) -> dict[str, list[str]]:
        (stages.folder / "poses").mkdir()
        write_poses(stages.folder / "poses" / "poses.npz", np.zeros((12, 3)), np.zeros((12, 24, 3)))
        return {"notes": []}

    monkeypatch.setattr(complete, "_find_poses", stand)
    points = np.random.default_rng(0).uniform(20.0, 150.0, (17, 2))
    networks = PersonNetworks(
        mask=write_brightness(tmp_path / "mask.onnx", (96, 96), 0.0, 1.0),
        keypoints=write_points(tmp_path / "keypoints.onnx", SIZE, points),
    )
    found = _complete(own_film, tmp_path / "work", coarse_body, networks)
    masks = tmp_path / "work" / "masks"
    assert list(found.footage.masks) == [masks / f"{name}.png" for name in found.footage.names]
    assert found.footage.names[:2] == ("view_0/0.png", "view_0/1.png")
    assert read_keypoints(tmp_path / "work" / "keypoints" / KEYPOINTS_FILE, found.footage.names).uv_px.shape[0] == 12
