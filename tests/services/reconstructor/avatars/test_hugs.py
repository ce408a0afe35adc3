"""Planes and decoders of HUGS learn a body and a person, and are written as a checkpoint that is imported again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.avatars.importers import ImportOptions, import_human
from readygo.common.avatars.importers.hugs import decode_human
from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars import smpl_body
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.extract import Extraction, extract_avatar
from readygo.services.reconstructor.avatars.footage import SMPL_PELVIS_M, read_footage
from readygo.services.reconstructor.avatars.hugs import HugsFit, new_checkpoint, spread_body
from readygo.services.reconstructor.avatars.views import read_person
from tests.services.reconstructor.avatars.conftest import trajectory_of
from tests.services.reconstructor.avatars.test_smpl_body import smpl_file

CONFIG = AvatarFitConfig(representation="hugs", hugs_points=600, steps=20, hold_out=6)


def hugs_fit(film: Path, body: Avatar, config: AvatarFitConfig = CONFIG) -> HugsFit:
    footage = read_footage(film)
    person = read_person(footage, 96)
    return HugsFit(body, person, trajectory_of(footage), config, pelvis_m=SMPL_PELVIS_M, fixed_lengths=False)


def test_spread_body_moves_as_before(coarse_body: Avatar) -> None:
    spread = spread_body(coarse_body, SMPL_PELVIS_M)
    np.testing.assert_allclose(spread.joints_tpose_m[0], SMPL_PELVIS_M, atol=1e-6)
    assert spread.joints_canonical_m[7, 0] > coarse_body.joints_tpose_m[7, 0] + 0.3, "the left ankle is outwards"
    rng = np.random.default_rng(0)
    pose = rng.normal(0.0, 0.3, (24, 3))
    rigid = coarse_body.lbs_weight.max(axis=1) > 0.999
    means = [pose_avatar(body, np.zeros(3), pose).means_m[rigid] for body in (coarse_body, spread)]
    assert rigid.sum() > 100
    np.testing.assert_allclose(means[0], means[1], atol=2e-4)


def test_decoders_begin_as_round_gaussians_at_their_points() -> None:
    xyz = np.random.default_rng(0).uniform(-0.9, 0.9, (50, 3)).astype(np.float32)
    sizes = np.full((50, 1), 0.02, dtype=np.float32)
    decoded = {name: value.detach().numpy() for name, value in decode_human(new_checkpoint(xyz, sizes, 0)).items()}
    np.testing.assert_allclose(decoded["means"], xyz, atol=0.02)
    np.testing.assert_allclose(decoded["scales"], 0.02, rtol=0.2)
    np.testing.assert_allclose(decoded["weights"].sum(axis=1), 1.0, atol=1e-5)


def test_decoders_learn_the_body_and_then_frames(neuman_film: Path, coarse_body: Avatar) -> None:
    fit = hugs_fit(neuman_film, coarse_body, AvatarFitConfig(representation="hugs", hugs_points=600, steps=300))
    losses = []
    while fit.step < 60:
        fit.one_step()
        losses.append(fit.loss)
    assert losses[44] < 0.6 * losses[0], "the first 45 steps learn the body"
    before = fit.checkpoint["triplane"]["plane_xy"].detach().clone()
    pose = fit.rig.values["pose"].copy()
    fit.one_step()
    assert not torch.equal(before, fit.checkpoint["triplane"]["plane_xy"])
    assert not np.array_equal(fit.rig.values["pose"], pose)


def test_needles_count_if_asked(neuman_film: Path, coarse_body: Avatar) -> None:
    losses = []
    for weight in (0.0, 1e-2):
        fit = hugs_fit(neuman_film, coarse_body, replace(CONFIG, isotropy=weight))
        decoded = {name: value.detach() for name, value in decode_human(fit.checkpoint).items()}
        decoded["scales"][:, 0] *= 3.0
        losses.append(float(fit._pull(decoded).detach()))
    assert losses[1] > losses[0] + 1e-2 * len(decoded["scales"])


def test_state_comes_back(neuman_film: Path, coarse_body: Avatar) -> None:
    one, other = hugs_fit(neuman_film, coarse_body), hugs_fit(neuman_film, coarse_body)
    for _ in range(6):
        one.one_step()
        if one.step in (1, 5):
            other.load(one.step, {name: array.copy() for name, array in one.state().items()})
    other.one_step()
    for name, array in one.state().items():
        np.testing.assert_array_equal(array, other.state()[name], err_msg=name)


@pytest.fixture(scope="module")
def extracted(neuman_film: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Extraction, Path]:
    folder = tmp_path_factory.mktemp("hugs")
    smpl = smpl_file(folder / "SMPL_TEST.npz")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smpl_body, "GAUSSIANS", 2000)
        names = {"name": "someone", "license_text": "none"}
        return extract_avatar(neuman_film, folder / "work", CONFIG, lambda _: None, **names, smpl=smpl), smpl


def test_checkpoint_is_imported_as_the_avatar_that_was_extracted(
    extracted: tuple[Extraction, Path], tmp_path: Path
) -> None:
    extraction, smpl = extracted
    assert extraction.checkpoint is not None
    torch.save(extraction.checkpoint, tmp_path / "human.pth")
    options = ImportOptions(license="none", smpl=smpl, height_m=extraction.avatar.height_m)
    imported, report = import_human(tmp_path / "human.pth", options)
    assert report.scale == pytest.approx(1.0, abs=0.02)
    mine = extraction.avatar
    np.testing.assert_allclose(
        imported.joints_tpose_m - imported.joints_tpose_m[0],
        (mine.joints_tpose_m - mine.joints_tpose_m[0]) * report.scale,
        atol=1e-4,
    )
    # The avatar leaves out faint Gaussians and floaters; those that it keeps are all there.
    from scipy.spatial import cKDTree

    shift = imported.joints_canonical_m[0] - mine.joints_canonical_m[0] * report.scale
    away, _ = cKDTree(imported.cloud.means_m).query(mine.cloud.means_m * report.scale + shift)
    assert away.max() < 1e-4


def test_layout_is_that_of_released_checkpoints(extracted: tuple[Extraction, Path]) -> None:
    checkpoint = extracted[0].checkpoint
    assert checkpoint is not None
    assert {name: tuple(plane.shape) for name, plane in checkpoint["triplane"].items()} == dict.fromkeys(
        ("plane_xy", "plane_xz", "plane_yz"), (1, 32, 256, 256)
    )
    assert tuple(checkpoint["appearance_dec"]["shs.weight"].shape) == (48, 64)
    assert tuple(checkpoint["geometry_dec"]["xyz.0.2.weight"].shape) == (128, 128)
    assert tuple(checkpoint["deformation_dec"]["skinning_linear.weight_g"].shape) == (128, 1)
    assert set(checkpoint) >= {"xyz", "scaling_multiplier", "max_radii2D", "optimizer", "active_sh_degree"}
    assert not any(value.requires_grad for value in checkpoint["triplane"].values())


def test_body_beyond_the_planes_is_refused(neuman_film: Path, coarse_body: Avatar) -> None:
    footage = read_footage(neuman_film)
    with pytest.raises(AvatarError, match="beyond 1 m from SMPL's origin"):
        HugsFit(
            coarse_body,
            read_person(footage, 96),
            trajectory_of(footage),
            CONFIG,
            pelvis_m=np.array([0.0, 0.5, 0.0]),
            fixed_lengths=True,
        )
