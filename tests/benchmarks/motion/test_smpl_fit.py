import numpy as np
import pytest

from readygo.benchmarks.motion import smpl_fit
from readygo.benchmarks.motion.cmu import joints_20hz
from readygo.benchmarks.motion.smpl_fit import bone_offsets
from readygo.services.animator import skeleton_of
from readygo.services.animator.smpl.fit import fit_rotations
from tests.services.animator.bodies import make_avatar, spins_radps


@pytest.mark.parametrize("clip", ["01", "02", "03"])
def test_fit_of_mocap_with_its_own_bone_lengths_is_within_2_mm(shared_data, clip, monkeypatch):
    monkeypatch.setattr(smpl_fit, "RUNS", 0)
    P, _ = joints_20hz(shared_data / "motion" / "cmu", "02", clip)
    offsets = bone_offsets(P, skeleton_of(make_avatar()).offsets_m)
    row = smpl_fit.fit_row(P, offsets)
    assert row["rows"] == len(P)
    assert row["error_mean_mm"] < 1.5
    assert row["error_max_mm"] < 20.0
    G, _ = fit_rotations(P, offsets)
    assert spins_radps(G).max() < np.radians(800.0)
