import pytest
import torch
from torch import nn

from readygo.common.policy.artifact import FEATURE_COUNT, LATENT_COUNT
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.model import PolicyNet, images_from_bytes, parameter_count


@pytest.fixture(scope="module")
def model():
    return PolicyNet(RobotConfig()).eval()


def test_network_has_the_size_and_the_ten_convolutions_of_the_paper(model):
    convolutions = [module for module in model.encoder.modules() if isinstance(module, nn.Conv2d)]
    layers = [module for module in model.head.modules() if isinstance(module, nn.Linear)]
    assert len(convolutions) == 10
    assert len(layers) == 3
    assert layers[0].in_features == FEATURE_COUNT == 64
    assert 1.9e6 < parameter_count(model) < 2.1e6


def test_shared_frames_give_the_same_as_separate_ones(model):
    images = torch.rand(3, 3, 144, 256) * 2 - 1
    window = torch.tensor([[0, 1, 2], [1, 2, 2]])
    latents = model.encoder(images)
    assert torch.equal(model.encode_windows(images, window)[1], latents[[1, 2, 2]].reshape(-1))
    assert latents.shape == (3, LATENT_COUNT)


def test_withheld_previous_action_reads_as_half_speed_straight_on(model):
    assert model.normalise_previous(torch.tensor([[0.5, 0.0]])).tolist() == [[0.0, 0.0]]


def test_answers_are_clipped_to_the_limits(model):
    clipped = model.clip(torch.tensor([[2.0, -3.0], [-1.0, 0.5]]))
    assert torch.allclose(clipped, torch.tensor([[1.0, -1.2], [0.0, 0.6]]))


def test_far_goals_look_alike(model):
    latents, previous = torch.zeros(1, 60), torch.zeros(1, 2)
    near, far, farther = (model.act(latents, previous, torch.tensor([[d, 0.0]])) for d in (5.0, 10.0, 30.0))
    assert torch.equal(far, farther)
    assert not torch.equal(near, far)


@pytest.mark.parametrize("size", [(8, 8), (90, 161), (240, 320)])
def test_other_image_sizes_fit(size):
    camera = CameraConfig(height_px=size[0], width_px=size[1])
    model = PolicyNet(RobotConfig(camera=camera)).eval()
    assert model.encoder(torch.zeros(1, 3, *size)).shape == (1, LATENT_COUNT)


def test_bytes_become_numbers_from_minus_one_to_one():
    images = images_from_bytes(torch.tensor([0, 255], dtype=torch.uint8).reshape(1, 2, 1, 1).expand(1, 2, 4, 3))
    assert images.shape == (1, 3, 2, 4)
    assert images[:, :, 0].unique().tolist() == [-1.0]
    assert images[:, :, 1].unique().tolist() == [1.0]
