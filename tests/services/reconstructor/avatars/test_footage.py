"""Films of people are read in both layouts, and refused in words."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars.footage import SMPL_FILE, read_footage


def test_both_layouts_say_the_same(neuman_film: Path, plain_film: Path) -> None:
    first, second = read_footage(neuman_film), read_footage(plain_film)
    assert first.names == second.names
    np.testing.assert_allclose(first.T_world_camera, second.T_world_camera, atol=1e-6)
    np.testing.assert_allclose(first.K_px, second.K_px, atol=1e-9)
    np.testing.assert_allclose(first.root_m, second.root_m, atol=1e-5)
    np.testing.assert_allclose(first.pose_axis_angle, second.pose_axis_angle, atol=1e-6)


def test_scale_of_the_model_makes_metres(neuman_film: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(neuman_film, tmp_path / "scaled"))
    before = read_footage(folder)
    path = folder / SMPL_FILE
    arrays = dict(np.load(path))
    arrays["scale"], arrays["transl"] = 2.0 * arrays["scale"], 2.0 * arrays["transl"]
    np.savez(path, **arrays)
    lines = (folder / "sparse" / "images.txt").read_text().splitlines()
    scaled = []
    for line in lines:
        words = line.split()
        words[5:8] = [repr(2.0 * float(word)) for word in words[5:8]]
        scaled.append(" ".join(words))
    (folder / "sparse" / "images.txt").write_text("\n".join(scaled) + "\n")
    after = read_footage(folder)
    np.testing.assert_allclose(after.root_m, before.root_m, atol=1e-5)
    np.testing.assert_allclose(after.T_world_camera, before.T_world_camera, atol=1e-6)


def test_missing_parts_are_named(own_film: Path, tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="is not a folder"):
        read_footage(tmp_path / "nowhere")
    (own_film / "images" / "00003.png").unlink()
    with pytest.raises(AvatarError, match=r"images lacks 1 of 12 files, 00003\.png"):
        read_footage(own_film)
    shutil.rmtree(own_film / "masks")
    with pytest.raises(AvatarError, match="has no masks"):
        read_footage(own_film)
    (own_film / "cameras.json").unlink()
    with pytest.raises(AvatarError, match=r"has no cameras\.json"):
        read_footage(own_film)
    (own_film / "poses.npz").unlink()
    with pytest.raises(AvatarError, match="has no poses"):
        read_footage(own_film)


def test_other_counts_and_models_are_refused(own_film: Path, neuman_film: Path, tmp_path: Path) -> None:
    poses = dict(np.load(own_film / "poses.npz"))
    np.savez(own_film / "poses.npz", root_m=poses["root_m"][:-1], pose_axis_angle=poses["pose_axis_angle"][:-1])
    with pytest.raises(AvatarError, match="poses of 11 frames, but 12 images"):
        read_footage(own_film)
    np.savez(own_film / "poses.npz", root_m=poses["root_m"], pose_axis_angle=poses["pose_axis_angle"][:, :22])
    with pytest.raises(AvatarError, match=r"must be \(F, 24, 3\)"):
        read_footage(own_film)
    folder = Path(shutil.copytree(neuman_film, tmp_path / "smplx"))
    arrays = dict(np.load(folder / SMPL_FILE))
    arrays["body_pose"] = arrays["body_pose"][:, :63]
    np.savez(folder / SMPL_FILE, **arrays)
    with pytest.raises(AvatarError, match="SMPL-X"):
        read_footage(folder)
    arrays["body_pose"] = np.zeros((12, 23, 3, 3), np.float32)
    np.savez(folder / SMPL_FILE, **arrays)
    with pytest.raises(AvatarError, match=r"rotation matrices \(207\)"):
        read_footage(folder)
    arrays["body_pose"] = np.float32(1.0)
    np.savez(folder / SMPL_FILE, **arrays)
    with pytest.raises(AvatarError, match="1 numbers a frame, SMPL has 69"):
        read_footage(folder)
    arrays["smpl_pose"] = arrays.pop("body_pose")
    np.savez(folder / SMPL_FILE, **arrays)
    with pytest.raises(AvatarError, match="lacks body_pose"):
        read_footage(folder)


def test_shape_of_a_person_is_given_once_or_for_each_frame(neuman_film: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(neuman_film, tmp_path / "shaped"))
    arrays = dict(np.load(folder / SMPL_FILE))
    betas = np.arange(10.0)
    for given in (betas, np.tile(betas, (12, 1)), np.tile(betas, (12, 1, 1))):
        np.savez(folder / SMPL_FILE, **arrays | {"betas": given})
        np.testing.assert_array_equal(read_footage(folder).betas, betas)
    for given in (np.zeros((0, 10)), np.zeros((12, 0))):
        np.savez(folder / SMPL_FILE, **arrays | {"betas": given})
        assert read_footage(folder).betas.shape == (0,)
    for given, said in ((np.full(10, np.nan), "betas hold values that are not finite"), (np.array("a"), "must hold")):
        np.savez(folder / SMPL_FILE, **arrays | {"betas": given})
        with pytest.raises(AvatarError, match=said):
            read_footage(folder)


def test_numbers_that_are_not_finite_are_refused(own_film: Path) -> None:
    poses = dict(np.load(own_film / "poses.npz"))
    poses["root_m"][2] = np.nan
    np.savez(own_film / "poses.npz", **poses)
    with pytest.raises(AvatarError, match="not finite"):
        read_footage(own_film)
    np.savez(own_film / "poses.npz", **poses | {"root_m": np.full((12, 3), "a")})
    with pytest.raises(AvatarError, match="root_m must hold numbers"):
        read_footage(own_film)


def test_cameras_are_in_the_order_of_names_as_text_in_which_the_poses_are(neuman_film: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(neuman_film, tmp_path / "short"))
    path, before = folder / "sparse" / "images.txt", read_footage(folder)
    text = path.read_text()
    for number in reversed(range(12)):
        text = text.replace(f" {number:05d}.png", f" {number}.png")
        for part in ("images", "masks", "segmentations"):
            if (folder / part).is_dir():
                (folder / part / f"{number:05d}.png").rename(folder / part / f"{number}.png")
    path.write_text(text)
    after = read_footage(folder)
    order = sorted(range(12), key=str)
    assert after.names == tuple(f"{number}.png" for number in order)
    np.testing.assert_array_equal(after.T_world_camera, before.T_world_camera[order])


def test_image_with_two_cameras_is_named(own_film: Path, neuman_film: Path, tmp_path: Path) -> None:
    cameras = json.loads((own_film / "cameras.json").read_text())
    cameras[5]["img_name"] = cameras[2]["img_name"]
    (own_film / "cameras.json").write_text(json.dumps(cameras))
    with pytest.raises(AvatarError, match=r"cameras\.json has 2 cameras for the image 00002\.png"):
        read_footage(own_film)
    folder = Path(shutil.copytree(neuman_film, tmp_path / "twice"))
    path = folder / "sparse" / "images.txt"
    path.write_text(path.read_text().replace(" 00005.png", " 00002.png"))
    with pytest.raises(AvatarError, match=r"00002\.png"):
        read_footage(folder)
