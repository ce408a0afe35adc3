import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks import unet  # noqa: E402


def test_schedule_is_the_published_one():
    ddpm = unet.Ddpm()
    assert ddpm.betas[[0, 4, 9]].tolist() == pytest.approx([0.027907, 0.237282, 0.999], abs=1e-6)
    assert ddpm.kept[[0, 5, 8]].tolist() == pytest.approx([0.972093, 0.340810, 0.024092], abs=1e-6)


def test_last_step_is_the_clean_sample_and_others_are_repeatable():
    ddpm, generator = unet.Ddpm(), torch.Generator().manual_seed(0)
    clean = torch.tensor([[[0.3, -2.0]]])
    noise = torch.tensor([[[0.5, 0.1]]])
    noisy = ddpm.kept[0].sqrt() * clean + (1 - ddpm.kept[0]).sqrt() * noise
    assert ddpm.back(noisy, noise, 0, generator)[0, 0].tolist() == pytest.approx([0.3, -1.0], abs=1e-5)
    again = [ddpm.back(noisy, noise, 5, torch.Generator().manual_seed(3)) for _ in range(2)]
    assert torch.equal(*again)


def test_noise_has_the_shape_of_the_sample_and_depends_on_the_condition():
    network = unet.ConditionalUnet(2, 16).eval()
    sample, step = torch.zeros(1, 8, 2), torch.tensor([3])
    first, second = (network(sample, step, torch.full((1, 16), value)) for value in (0.0, 1.0))
    assert first.shape == (1, 8, 2)
    assert not torch.allclose(first, second)
