import dataclasses

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.services.trainer import best_recipe
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.model import Bins, PolicyNet, parameter_count, weigh
from tests.crooked import TWINS


@pytest.fixture(scope="module")
def model():
    return PolicyNet(RobotConfig(), NetworkConfig()).eval()


def test_default_network_has_the_size_and_the_ten_convolutions_of_the_paper(model):
    convolutions = [module for module in model.encoder.modules() if isinstance(module, nn.Conv2d)]
    layers = [module for module in model.head.modules() if isinstance(module, nn.Linear)]
    assert len(convolutions) == 10
    assert len(layers) == 3
    assert layers[0].in_features == 65
    assert 1.9e6 < parameter_count(model) < 2.1e6


def test_best_network_is_within_the_paper_s_size():
    camera = CameraConfig(height_px=144, width_px=256)
    model = PolicyNet(RobotConfig(camera=camera), best_recipe().network, reads_humans=True)
    assert model.pooling == 2
    assert parameter_count(model) < 2.1e6


def test_shared_frames_give_the_same_as_separate_ones(model):
    images = torch.rand(3, 3, 144, 256) * 2 - 1
    latents = model.encoder(images)
    encoded = model.encode_windows(images, torch.tensor([[0, 1, 2], [1, 2, 2]]))
    assert torch.equal(encoded[1], latents[[1, 2, 2]].reshape(-1))


def test_early_fusion_sees_the_frames_stacked_oldest_first():
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    model = PolicyNet(robot, NetworkConfig(fusion="early", latent_count=5)).eval()
    images = torch.rand(4, 3, 16, 16)
    encoded = model.encode_windows(images, torch.tensor([[3, 0, 2]]))
    assert encoded.shape == (1, 5)
    assert torch.allclose(encoded, model.encoder(torch.cat([images[3], images[0], images[2]])[None]), atol=1e-6)


def test_withheld_previous_action_is_none_that_can_be_executed(model):
    known, withheld = model.normalise_motion(torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    assert known.tolist() == [0, 0, 1]
    assert withheld.tolist() == [0, 0, 0]
    assert torch.allclose(model.normalise_motion(torch.tensor([[0.5, -0.6, 1.0]])), torch.tensor([[0.5, -0.5, 1.0]]))


def test_answers_are_clipped_to_the_limits(model):
    clipped = model.clip(torch.tensor([[2.0, -3.0], [-1.0, 0.5]]))
    assert torch.allclose(clipped, torch.tensor([[1.0, -1.2], [0.0, 0.6]]))


def test_far_goals_look_alike(model):
    latents, motion = torch.zeros(1, 60), torch.zeros(1, 3)
    near, far, farther = (model.act(latents, motion, torch.tensor([[d, 0.0]])) for d in (5.0, 10.0, 30.0))
    assert torch.equal(far, farther)
    assert not torch.equal(near, far)


@pytest.mark.parametrize("size", [(8, 8), (90, 161), (240, 320)])
def test_other_image_sizes_fit(size):
    camera = CameraConfig(height_px=size[0], width_px=size[1])
    model = PolicyNet(RobotConfig(camera=camera), NetworkConfig()).eval()
    assert model.encoder(torch.zeros(1, 3, *size)).shape == (1, 20)


def test_a_likely_command_that_ends_in_a_collision_gives_way_to_the_next_one():
    likely = torch.tensor([[2.0, 1.0, -3.0]])
    safe, risky = torch.full((1, 3), -20.0), torch.tensor([[20.0, -20.0, -20.0]])
    assert weigh(torch.cat([likely, safe, safe], dim=1), 9.0).argmax() == 0
    for answers in ([likely, risky, safe], [likely, safe, risky]):
        assert weigh(torch.cat(answers, dim=1), 9.0).argmax() == 1
        assert weigh(torch.cat(answers, dim=1), 0.0).argmax() == 0


def test_weights_of_bins_mean_the_action_and_touch_four_bins():
    bins = Bins(9, 17)
    actions = torch.tensor([[0.3, -0.77], [1.4, 0.0]])
    weights = bins.weights(actions)
    assert torch.allclose(weights.sum(dim=1), torch.ones(2), atol=1e-5)
    assert torch.allclose(weights @ bins.centres, torch.tensor([[0.3, -0.77], [1.0, 0.0]]), atol=1e-5)
    assert ((weights > 1e-6).sum(dim=1) <= 4).all()


def test_mode_is_not_the_mean_of_two_ways_around():
    bins = Bins(5, 9)
    left, right = bins.weights(torch.tensor([[1.0, 0.7]])), bins.weights(torch.tensor([[1.0, -0.7]]))
    logits = (0.6 * left + 0.4 * right + 1e-6).log()
    assert torch.allclose(bins.mode(logits), torch.tensor([[1.0, 0.7]]), atol=0.02)


def test_a_network_takes_its_commands_along_to_a_device():
    """As to CUDA; "meta" is the one other device that every machine has."""
    net = PolicyNet(RobotConfig(), NetworkConfig(output="weighed"))
    assert not net.bins.centres.is_meta
    moved = net.to("meta").bins
    assert all(value.is_meta for value in (moved.steps, moved.centres, moved.beside, moved.standing))
    assert not any(name.startswith("bins") for name in net.state_dict())


def test_humans_are_read_in_training_alone():
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    inputs = torch.rand(3, 3, 16, 16), torch.tensor([[0, 1, 2]]), torch.zeros(1, 3), torch.zeros(1, 2)
    assert PolicyNet(robot, NetworkConfig()).eval()(*inputs)[1].shape == (1, 0)
    reader = PolicyNet(robot, NetworkConfig(), reads_humans=True).eval()
    assert reader(*inputs)[1].shape == (1, 3)
    assert parameter_count(reader) == parameter_count(PolicyNet(robot, NetworkConfig()))


@settings(deadline=None)
@given(
    v_bins=st.integers(3, 9), w_bins=st.integers(3, 17), backward=st.integers(0, 3),
    v=st.floats(-1.5, 1.5), w=st.floats(-1.5, 1.5),
)  # fmt: skip
def test_weights_of_bins_mean_the_action_also_backwards(v_bins, w_bins, backward, v, w):
    bins = Bins(v_bins, w_bins, backward)
    lowest = -backward / (v_bins - 1)
    weights = bins.weights(torch.tensor([[v, w]]))
    mean = (weights @ bins.centres)[0].tolist()
    assert weights.min() >= 0.0
    assert weights.sum().item() == pytest.approx(1.0, abs=1e-4)
    assert mean == pytest.approx([min(max(v, lowest), 1.0), min(max(w, -1.0), 1.0)], abs=1e-4)
    assert bins.centres.shape == ((v_bins + backward) * w_bins, 2)
    assert bins.centres[0].tolist() == pytest.approx([lowest, -1.0])
    assert bins.centres[1].tolist() == pytest.approx([lowest, -1.0 + 2 / (w_bins - 1)])


def test_mode_weighs_the_likeliest_bin_and_its_eight_neighbours_alone():
    bins = Bins(5, 9)
    rng = torch.Generator().manual_seed(3)
    logits = 3 * torch.rand((20, 45), generator=rng)
    for row in logits:
        best = int(row.argmax())
        v, w = divmod(best, 9)
        near = [9 * i + k for i in range(v - 1, v + 2) for k in range(w - 1, w + 2) if 0 <= i < 5 and 0 <= k < 9]
        shares = row[near].double().exp()
        expected = (shares / shares.sum()) @ bins.centres[near].double()
        assert bins.mode(row[None])[0].tolist() == pytest.approx(expected.tolist(), abs=1e-5)


def test_scores_of_commands_are_log_shares_less_what_both_risks_cost():
    answers = torch.tensor([[0.3, -1.2, 2.0, 0.7, -0.4, 0.1, -2.0, 1.5, 0.9]])
    likely, obstacle, human = answers[0].double().chunk(3)
    shares = likely.exp() / likely.exp().sum()
    expected = shares.log() - 2.5 * (1 / (1 + (-obstacle).exp()) + 1 / (1 + (-human).exp()))
    assert weigh(answers, 2.5)[0].tolist() == pytest.approx(expected.tolist(), abs=1e-5)


@pytest.mark.parametrize("motion", ["poses", "command"])
def test_motion_of_a_robot_of_ranges_is_in_units_of_its_own_limits(motion):
    robot = dataclasses.replace(
        TWINS, cameras={}, ranges=RobotRanges(v_max_mps=(0.5, 1.5), w_max_radps=(0.7, 1.3)), v_max_mps=0.8
    )
    model = PolicyNet(robot, NetworkConfig(motion=motion)).eval()
    traits = torch.tensor([[0.5, 1.0, 0.1, 0.3, 0.6, 1.1], [0.5, 1.0, 0.1, 0.3, 1.4, 0.75]])
    poses = [-1.3, 0.4, 0.2, -0.6, 0.1, -0.3]
    told = torch.tensor([[*poses, 0.3, -0.55]] * 2 if motion == "poses" else [[0.3, -0.55, 1.0]] * 2)
    found = model.normalise_motion(told, traits)
    commands = found[:, -2:] if motion == "poses" else found[:, :2]
    assert commands.tolist() == [pytest.approx([0.5, -0.5]), pytest.approx([0.3 / 1.4, -0.55 / 0.75])]
    rest = found[:, :-2] if motion == "poses" else found[:, 2:]
    assert rest.tolist() == [pytest.approx(poses if motion == "poses" else [1.0])] * 2
    slowest = robot.v_min_mps / robot.v_max_mps
    clipped = model.clip(torch.tensor([[-2.0, 1.7], [0.5, -0.25]]), traits)
    assert clipped.tolist() == [pytest.approx([slowest * 0.6, 1.1]), pytest.approx([0.7, -0.1875])]


def test_motion_and_answers_of_one_robot_are_in_units_of_its_limits():
    robot = dataclasses.replace(TWINS, cameras={})
    model = PolicyNet(robot, NetworkConfig(motion="poses")).eval()
    told = torch.tensor([[-1.3, 0.4, 0.2, -0.6, 0.1, -0.3, 0.17, -0.19]])
    found = model.normalise_motion(told)[0].tolist()
    assert found == pytest.approx([-1.3, 0.4, 0.2, -0.6, 0.1, -0.3, 0.17 / 0.85, -0.19 / 0.95])
    clipped = model.clip(torch.tensor([[-0.9, 0.4], [0.5, -1.4]]))
    assert clipped.tolist() == [pytest.approx([-0.2, 0.38]), pytest.approx([0.425, -0.95])]
