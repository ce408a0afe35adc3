"""The user's SMPL body begins a fit, in the shape and at the place that the footage tells."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.common.frames import zup_from_yup
from readygo.services.reconstructor.avatars import smpl_body
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.extract import extract_avatar
from readygo.services.reconstructor.avatars.footage import SMPL_PELVIS_M, read_footage
from readygo.services.reconstructor.avatars.smpl_body import read_smpl_body
from tests.common.avatars.importers.humans import smpl_entries, tpose_joints_m

DOWN_M = SMPL_PELVIS_M - tpose_joints_m()[0]
"""Moves the pelvis of the test's model to that of SMPL's mean shape."""


@pytest.fixture(autouse=True)
def _few_gaussians(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smpl_body, "GAUSSIANS", 2000)


def smpl_file(path: Path, moved_m: np.ndarray = DOWN_M) -> Path:
    """A small SMPL model; beta 0 makes it 10 % larger."""
    entries = smpl_entries()
    regressor = entries["J_regressor"].toarray()
    np.savez(path, **entries | {"v_template": entries["v_template"] + moved_m, "J_regressor": regressor})
    return path


def test_body_has_the_joints_weights_and_shape_of_the_file(tmp_path: Path, neuman_film: Path) -> None:
    footage = read_footage(neuman_film)
    assert footage.betas is not None
    path = smpl_file(tmp_path / "SMPL_TEST.npz")
    body, placed, pelvis_m = read_smpl_body(path, footage)
    assert body.name == "SMPL_TEST"
    np.testing.assert_allclose(pelvis_m, SMPL_PELVIS_M, atol=1e-12)
    assert 1000 < len(body.cloud) <= 2000
    joints_m = tpose_joints_m()
    np.testing.assert_allclose(np.diff(body.joints_tpose_m, axis=0), np.diff(joints_m, axis=0), atol=1e-5)
    np.testing.assert_array_equal(body.R_tpose_canonical, np.tile(np.eye(3), (24, 1, 1)))
    np.testing.assert_allclose(placed.root_m, footage.root_m, atol=1e-12, err_msg="the pelvis is that of SMPL")
    larger, _, _ = read_smpl_body(path, replace(footage, betas=np.array([1.0, 0.0])))
    np.testing.assert_allclose(np.diff(larger.joints_tpose_m, axis=0), 1.1 * np.diff(joints_m, axis=0), atol=1e-5)


def test_translations_of_smpl_move_the_pelvis_of_the_file(tmp_path: Path, neuman_film: Path, plain_film: Path) -> None:
    footage, plain = read_footage(neuman_film), read_footage(plain_film)
    moved_m = np.array([0.01, 0.02, 0.03])
    path = smpl_file(tmp_path / "a.npz", DOWN_M + moved_m)
    _, placed, _ = read_smpl_body(path, footage)
    np.testing.assert_allclose(placed.root_m - footage.root_m, np.tile(zup_from_yup(moved_m), (12, 1)), atol=1e-9)
    assert plain.betas is None
    np.testing.assert_array_equal(read_smpl_body(path, plain)[1].root_m, plain.root_m)


def test_fit_begins_with_the_body_of_the_file(tmp_path: Path, neuman_film: Path) -> None:
    config = AvatarFitConfig(steps=12, hold_out=6, gaussians_max=3000)
    found = extract_avatar(
        neuman_film,
        tmp_path / "work",
        config,
        lambda _: None,
        name="someone",
        license_text="none",
        smpl=smpl_file(tmp_path / "SMPL_TEST.npz"),
    )
    assert found.report["body"] == "SMPL_TEST"
    assert found.avatar.name == "someone"


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (
            {"kintree_table": np.zeros((2, 55), np.int64), "J_regressor": np.zeros((24, 1))},
            "has 55 joints: it is SMPL-X",
        ),
        ({"f": np.zeros((0, 3), np.int64)}, "has no faces"),
    ],
)
def test_a_body_that_cannot_be_read_is_told_before_footage_is(
    tmp_path: Path, changed: dict[str, np.ndarray], told: str
) -> None:
    with np.load(smpl_file(tmp_path / "SMPL_NEUTRAL.npz")) as entries:
        np.savez(tmp_path / "SMPLX_NEUTRAL.npz", **dict(entries) | changed)
    with pytest.raises(AvatarError, match=told) as error:
        extract_avatar(
            tmp_path / "footage that is missing",
            tmp_path / "work",
            AvatarFitConfig(),
            lambda _: None,
            name="someone",
            license_text="none",
            smpl=tmp_path / "SMPLX_NEUTRAL.npz",
        )
    assert "\n" not in str(error.value)
    assert not (tmp_path / "work").exists()
