"""An extraction gives an avatar with its measures, resumes, and refuses what cannot be a person."""

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.errors import AvatarError
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.services.reconstructor.avatars import extract
from readygo.services.reconstructor.avatars.body import swap_sides
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.extract import (
    CHECKPOINT_FILE,
    GREY,
    Extraction,
    ExtractionProgress,
    _identity,
    compare_person,
    extract_avatar,
    forget_extraction,
)
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.footage import read_footage
from readygo.services.reconstructor.avatars.views import read_person, view_at
from tests.services.reconstructor.avatars.conftest import trajectory_of

CONFIG = AvatarFitConfig(steps=24, hold_out=6, gaussians_max=2000)


def _extract(film: Path, work: Path, body: Avatar, tell: "object" = lambda _: None) -> Extraction:
    return extract_avatar(
        film,
        work,
        CONFIG,
        tell,
        name="someone",
        license_text="none",
        bodies={body.name: body},  # type: ignore[arg-type]
    )


def test_interrupted_extraction_resumes_to_the_same_result(
    neuman_film: Path, coarse_body: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _extract(neuman_film, tmp_path / "whole", coarse_body)
    assert whole.report["frames"] == 12
    assert [each.image for each in whole.held_out] == ["00000.png", "00006.png"]
    assert whole.report["psnr_db"] == pytest.approx(np.mean([each.psnr_db for each in whole.held_out]), abs=1e-3)
    assert whole.report["psnr_db"] > 12.0
    assert whole.joints_m.shape == (12, 24, 3)

    def interrupt(at: ExtractionProgress) -> None:
        if at.step == 10:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("readygo.services.reconstructor.avatars.extract._TELL_EVERY_S", 0.0)
    with pytest.raises(KeyboardInterrupt):
        _extract(neuman_film, tmp_path / "work", coarse_body, interrupt)
    assert (tmp_path / "work" / CHECKPOINT_FILE).is_file()
    steps: list[int] = []
    resumed = _extract(neuman_film, tmp_path / "work", coarse_body, lambda at: steps.append(at.step))
    assert steps[0] > 10
    np.testing.assert_array_equal(resumed.avatar.cloud.means_m, whole.avatar.cloud.means_m)
    np.testing.assert_array_equal(resumed.pose_axis_angle, whole.pose_axis_angle)
    forget_extraction(tmp_path / "work")
    assert not (tmp_path / "work").exists()


def test_swapped_sides_and_strange_poses_leave_nothing(own_film: Path, coarse_body: Avatar, tmp_path: Path) -> None:
    work = tmp_path / "work"
    poses = dict(np.load(own_film / "poses.npz"))
    np.savez(own_film / "poses.npz", root_m=poses["root_m"], pose_axis_angle=swap_sides(poses["pose_axis_angle"]))
    with pytest.raises(AvatarError, match="sides of the joints are swapped"):
        _extract(own_film, work, coarse_body)
    np.savez(own_film / "poses.npz", root_m=poses["root_m"] + [1.0, 0.0, 0.0], pose_axis_angle=poses["pose_axis_angle"])
    with pytest.raises(AvatarError, match="look at the cameras"):
        _extract(own_film, work, coarse_body)
    assert not work.exists()


def test_held_out_pictures_are_of_the_avatar_that_is_written(
    plain_film: Path, coarse_body: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def upper_half(avatar: Avatar, _distance_m: float) -> Avatar:
        kept = avatar.cloud.means_m[:, 1] > 0.5 * avatar.height_m
        joint, weight = avatar.lbs_index[kept], avatar.lbs_weight[kept]
        return replace(avatar, cloud=avatar.cloud.select(kept), lbs_index=joint, lbs_weight=weight)

    assert _extract(plain_film, tmp_path / "work", coarse_body).report["dropped_db"] < 1.0
    monkeypatch.setattr(extract, "without_floaters", upper_half)
    made = _extract(plain_film, tmp_path / "work", coarse_body)
    assert made.report["dropped_db"] > 2.0, "half of the person is left out"
    assert made.report["dropped"] > 0.3 * made.report["gaussians"]
    view = view_at(read_person(read_footage(plain_film), CONFIG.side_max_px), 6, 1)
    cloud = pose_avatar(made.avatar, made.root_m[6], made.pose_axis_angle[6])
    drawn = rasterize_reference(cloud, view.T_world_camera, view.K_px, *view.mask.shape)
    expected = np.clip(drawn.rgb + GREY * (1.0 - drawn.alpha[..., None]), 0.0, 1.0).transpose(2, 0, 1)
    shown = made.held_out[1]
    assert shown.image == "00006.png"
    np.testing.assert_allclose(shown.rendered, expected, atol=0.02)
    assert shown.psnr_db == pytest.approx(compare_person("", view, expected.astype(np.float32)).psnr_db, abs=0.02)


def test_checkpoint_is_of_one_version_and_of_images_and_masks_as_they_were(
    own_film: Path, coarse_body: Avatar, monkeypatch: pytest.MonkeyPatch
) -> None:
    footage = read_footage(own_film)
    fit = PersonFit(coarse_body, read_person(footage, 96), trajectory_of(footage), CONFIG)
    identities = {_identity(footage, fit)}
    assert _identity(footage, fit) in identities
    for path in (footage.images[3], footage.masks[5]):
        os.utime(path, ns=(0, 0))
        identities.add(_identity(footage, fit))
    monkeypatch.setattr(extract, "code_digest", lambda *_: "another version")
    identities.add(_identity(footage, fit))
    assert len(identities) == 4
