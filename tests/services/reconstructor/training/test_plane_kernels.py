"""Features of planes and their derivatives against those of torch in float64."""

import numpy as np
import torch

from readygo.services.reconstructor.training.plane_kernels import add_feature_slopes, write_features
from readygo.services.reconstructor.training.planes import plane_features

CAMERA_M = np.array([0.3, -0.2, 0.5])


def gaussians(count: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    arrays = rng.normal(size=(count, 3)), 2.0 * rng.normal(size=(count, 4)), rng.uniform(0.01, 0.3, (count, 3))
    means, quats, scales = (array.astype(np.float32) for array in arrays)
    scales[0] = 0.1
    return means, quats, scales


def test_features_are_those_of_torch() -> None:
    arrays = gaussians()
    out = np.empty((60, 4), dtype=np.float32)
    write_features(*arrays, CAMERA_M, out)
    wanted = plane_features(*(torch.tensor(array).double() for array in arrays), torch.tensor(CAMERA_M))
    np.testing.assert_allclose(out, wanted, atol=1e-6)
    assert {int(k) for k in arrays[2].argmin(axis=1)} == {0, 1, 2}


def test_slopes_of_some_are_those_that_torch_derives() -> None:
    arrays, rows = gaussians(), np.arange(0, 60, 2)
    slope = np.random.default_rng(1).normal(size=(30, 4)).astype(np.float32)
    means, quats, scales = (torch.tensor(array[rows]).double() for array in arrays)
    means.requires_grad_()
    quats.requires_grad_()
    plane_features(means, quats, scales, torch.tensor(CAMERA_M)).backward(torch.tensor(slope).double())
    by_means, by_quats = np.ones((30, 3), np.float32), np.ones((30, 4), np.float32)
    add_feature_slopes(*arrays, CAMERA_M, rows, slope, by_means, by_quats)
    assert means.grad is not None
    assert quats.grad is not None
    np.testing.assert_allclose(by_means - 1.0, means.grad, atol=1e-5)
    np.testing.assert_allclose(by_quats - 1.0, quats.grad, atol=1e-5 * float(quats.grad.abs().max()))
