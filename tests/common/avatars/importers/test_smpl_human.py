from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars.importers import ImportOptions, import_human, load_smpl_model
from readygo.common.avatars.importers.joints import JOINT
from readygo.common.avatars.importers.smpl_human import smpl_human
from readygo.common.errors import AvatarError
from readygo.common.gaussians import rgb_of_sh
from tests.common.avatars.importers.humans import HEIGHT_M, tpose_joints_m, write_smpl_pickle


def test_model_becomes_a_human_in_plain_clothes(tmp_path: Path) -> None:
    path = write_smpl_pickle(tmp_path / "SMPL_NEUTRAL.pkl")
    avatar, report = import_human(path, ImportOptions(license="own", gaussians=3000))
    assert (report.kind, report.name) == ("SMPL model", "SMPL_NEUTRAL")
    assert avatar.height_m == pytest.approx(HEIGHT_M, abs=0.01)
    np.testing.assert_allclose(avatar.joints_tpose_m, tpose_joints_m(), atol=0.005)
    np.testing.assert_array_equal(avatar.R_tpose_canonical, np.tile(np.eye(3), (24, 1, 1)))
    colours = {
        joint: np.median(avatar.cloud.sh[avatar.lbs_index[:, 0] == JOINT[joint], 0], axis=0)
        for joint in ("spine3", "left_knee", "left_elbow", "left_foot")
    }
    assert len({tuple(np.round(colour, 2)) for colour in colours.values()}) == 4


def test_body_without_faces_has_no_surface_to_draw(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="no faces"):
        import_human(write_smpl_pickle(tmp_path / "a.pkl", drop=("f",)), ImportOptions(license="own"))


def test_hair_covers_the_crown_and_not_the_face(tmp_path: Path) -> None:
    cloud = smpl_human(load_smpl_model(write_smpl_pickle(tmp_path / "a.pkl")), count=3000)[0].cloud
    dark = rgb_of_sh(cloud.sh[:, 0]).max(axis=1) < 0.3
    x, y, z = cloud.means_m.T
    head = (y > 1.58) & (np.abs(x) < 0.1)
    assert dark[head & (y > HEIGHT_M - 0.01)].all()
    assert not dark[head & (y < 1.63) & (z > 0.08)].any()


def test_dressed_model_is_as_it_was(tmp_path: Path, golden_figures) -> None:
    human = smpl_human(load_smpl_model(write_smpl_pickle(tmp_path / "a.pkl")), count=1500)[0]
    golden_figures("avatars/dressed", 5.0 * human.cloud.means_m, 50.0 * human.cloud.scales_m, human.cloud.sh[:, 0])
    golden_figures("avatars/dressed skin", human.weights)
