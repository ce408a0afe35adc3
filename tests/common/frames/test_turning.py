import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from readygo.common.frames.turning import turn_between


def between(first, last, share):
    out = np.empty((len(first), 3), np.float32)
    turn_between(np.asarray(first, np.float32), np.asarray(last, np.float32), share, out)
    return out


def test_rotation_goes_evenly_along_the_shorter_way():
    assert between([[0.0, 0.0, 0.2]], [[0.0, 0.0, 1.0]], 0.25)[0] == pytest.approx([0.0, 0.0, 0.4], abs=1e-6)
    # From 3 rad to -3 rad it is 0.28 rad on, not 6 back.
    assert between([[0.0, 3.0, 0.0]], [[0.0, -3.0, 0.0]], 0.5)[0, 1] == pytest.approx(np.pi, abs=1e-6)


def test_ends_are_the_rotations_themselves():
    rng = np.random.default_rng(0)
    first, last = rng.uniform(-1, 1, (2, 24, 3)).astype(np.float32)
    np.testing.assert_allclose(between(first, last, 0.0), first, atol=1e-6)
    np.testing.assert_allclose(between(first, last, 1.0), last, atol=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.37, 0.8])
def test_rotations_between_are_those_of_slerp(share):
    first, last = (Rotation.random(30, random_state=seed).as_rotvec().astype(np.float32) for seed in (1, 2))
    found = Rotation.from_rotvec(between(first, last, share))
    for k in range(30):
        expected = Slerp([0.0, 1.0], Rotation.from_rotvec([first[k], last[k]]))(share)
        assert (expected.inv() * found[k]).magnitude() < 1e-5
    assert np.linalg.norm(found.as_rotvec(), axis=1).max() <= np.pi + 1e-6
