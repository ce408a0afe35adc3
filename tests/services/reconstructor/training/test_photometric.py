"""The photometric loss against a float64 implementation of its own."""

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.training.photometric import Photometric, fit_colours, photometric_loss, psnr_db


def reference_loss(image: torch.Tensor, photo: torch.Tensor, weight: float) -> tuple[torch.Tensor, torch.Tensor]:
    """The loss and the SSIM by convolutions in two dimensions."""
    x = torch.arange(11, dtype=torch.float64) - 5
    line = torch.exp(-(x**2) / (2 * 1.5**2))
    window = torch.outer(line, line)
    window = (window / window.sum())[None, None]

    def blurred(planes: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.conv2d(planes[:, None], window, padding=5)[:, 0]

    mean_x, mean_y = blurred(image), blurred(photo)
    var_x, var_y = blurred(image**2) - mean_x**2, blurred(photo**2) - mean_y**2
    covariance = blurred(image * photo) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    ssim = ((2 * mean_x * mean_y + c1) * (2 * covariance + c2)) / ((mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2))
    return (1 - weight) * (image - photo).abs().mean() + weight * (1 - ssim.mean()), ssim.mean()


@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_loss_and_its_derivative_are_those_of_the_definition(weight: float) -> None:
    rng = np.random.default_rng(0)
    image, photo = (rng.random((3, 19, 37)).astype(np.float32) for _ in range(2))
    photo[:, :8] = image[:, :8] + 0.02
    x = torch.tensor(image, dtype=torch.float64, requires_grad=True)
    wanted, wanted_ssim = reference_loss(x, torch.tensor(photo, dtype=torch.float64), weight)
    wanted.backward()
    loss, ssim, slope = Photometric(19, 37)(image, photo, weight)
    assert loss == pytest.approx(float(wanted.detach()), abs=1e-5)
    assert ssim == pytest.approx(float(wanted_ssim.detach()), abs=1e-5)
    assert x.grad is not None
    np.testing.assert_allclose(slope, x.grad.numpy(), atol=1e-5 * float(x.grad.abs().max()))


@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_loss_that_torch_derives_is_that_of_the_definition(weight: float) -> None:
    rng = np.random.default_rng(2)
    x = torch.tensor(rng.random((3, 9, 37)), dtype=torch.float32, requires_grad=True)
    photo = torch.tensor(rng.random((3, 9, 37)), dtype=torch.float32)
    exact = x.detach().double().requires_grad_()
    wanted, _ = reference_loss(exact, photo.double(), weight)
    wanted.backward()
    loss = photometric_loss(x, photo, weight)
    loss.backward()
    assert float(loss.detach()) == pytest.approx(float(wanted.detach()), abs=1e-5)
    assert x.grad is not None
    assert exact.grad is not None
    np.testing.assert_allclose(x.grad.numpy(), exact.grad.numpy(), atol=1e-5 * float(exact.grad.abs().max()))


def test_nothing_of_one_image_is_left_for_the_next() -> None:
    rng = np.random.default_rng(1)
    image, photo = (rng.random((3, 12, 20)).astype(np.float32) for _ in range(2))
    loss = Photometric(12, 20)
    first = loss(image, photo, 0.2)[2].copy()
    loss(photo, photo, 0.2)
    np.testing.assert_array_equal(loss(image, photo, 0.2)[2], first)


def test_psnr_of_a_known_error() -> None:
    photo = np.full((3, 4, 4), 0.5, dtype=np.float32)
    assert psnr_db(photo + np.float32(0.1), photo) == pytest.approx(20.0, abs=1e-4)


def test_fitted_colours_take_out_exposure_and_white_balance_and_nothing_else() -> None:
    rng = np.random.default_rng(5)
    photo = rng.uniform(0.2, 0.8, (3, 12, 16)).astype(np.float32)
    tinted = np.array([0.8, 1.1, 0.9], np.float32)[:, None, None] * photo + np.float32(0.03)
    assert psnr_db(tinted, photo) < 25
    assert psnr_db(fit_colours(tinted, photo), photo) > 80
    noisy = photo + rng.normal(0.0, 0.1, photo.shape).astype(np.float32)
    assert psnr_db(fit_colours(noisy, photo), photo) == pytest.approx(psnr_db(noisy, photo), abs=1.5)
    grey = np.full((3, 4, 4), 0.5, np.float32)
    np.testing.assert_allclose(fit_colours(grey, 0.6 * grey), 0.3, atol=1e-6)
