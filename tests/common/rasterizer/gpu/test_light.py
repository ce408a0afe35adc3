import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.gaussians.irradiance import irradiance, irradiance_matrix, rotate_forms  # noqa: E402
from readygo.common.rasterizer.constants import LIGHT_MAX, LIGHT_MIN  # noqa: E402
from readygo.common.rasterizer.gpu.batch import OWN_COLOURS  # noqa: E402
from readygo.common.rasterizer.gpu.light import gains, turned_terms  # noqa: E402

RNG = np.random.default_rng(0)
LIGHT = irradiance_matrix(RNG.normal(1.0, 1.0, size=(9, 3)))
NORMALS = RNG.normal(size=(40, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)


def test_gain_is_the_root_of_the_light_within_its_limits() -> None:
    values = irradiance(LIGHT, NORMALS)
    assert (values < LIGHT_MIN).any()
    found = gains(torch.from_numpy(LIGHT), torch.from_numpy(NORMALS)).numpy()
    assert found == pytest.approx(np.sqrt(np.clip(values, LIGHT_MIN, LIGHT_MAX)))


def test_own_colours_stay_as_they_are() -> None:
    assert (gains(torch.from_numpy(OWN_COLOURS), torch.from_numpy(NORMALS)) == 1.0).all()


def test_terms_are_those_of_the_cpu() -> None:
    R, _ = np.linalg.qr(RNG.normal(size=(3, 3)))
    expected = np.empty((3, 10), dtype=np.float32)
    rotate_forms(LIGHT, R, expected)
    found = turned_terms(torch.from_numpy(np.stack([LIGHT, LIGHT])), torch.from_numpy(R)).numpy()
    assert found.shape == (2, 3, 10)
    assert found[1] == pytest.approx(expected, abs=1e-6)
