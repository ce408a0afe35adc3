import dataclasses
import math

import numpy as np
import pytest
import torch

from readygo.common.robot.command_grid import HUMAN, OBSTACLE, UNKNOWN_RISK
from readygo.common.robot.command_grid import mirrored as mirrored_commands
from readygo.services.trainer import with_overrides
from readygo.services.trainer.episodes import read_episodes
from readygo.services.trainer.goals import own_goals
from readygo.services.trainer.model import Bins, PolicyNet
from readygo.services.trainer.objective import Objective, humans_loss, risks_loss
from readygo.services.trainer.parts import Part, build_parts, timing_of
from tests.services.trainer.conftest import QUICK, quick

LEFT = torch.tensor([1.0, -1.0])
SAMPLES = np.arange(3, 120, 7)
STILL = {"hindsight": 0.0, "photometric": 0.0, "previous_noise": 0.0, "previous_dropout": 0.0}


@pytest.fixture
def show(source):
    """What the network is shown in training."""

    def shown(dtype=torch.float32, **settings):
        config = quick(**{"network": QUICK.network, **STILL, **settings})
        part = build_parts(source, None, config)[0]
        objective = Objective(source.robot, config, timing_of(source.robot, config), dtype)
        return objective.training(part.table, part.frames, SAMPLES, np.random.default_rng(0)), part, objective

    return shown


@pytest.mark.parametrize("motion", ["poses", "command"])
def test_mirrored_batch_is_the_flipped_image_with_goal_motion_and_turns_to_the_other_side(show, motion):
    plain, mirrored = show(motion=motion)[0], show(motion=motion, mirror=1.0)[0]
    signs = torch.tensor([1.0, -1, -1, 1, -1, -1, 1, -1] if motion == "poses" else [1.0, -1, 1])
    assert plain.goals_xy_m.abs().min() > 0
    assert plain.targets[:, 1].abs().max() > 0.5
    assert not torch.equal(plain.images, plain.images.flip(3))
    assert torch.equal(mirrored.images, plain.images.flip(3))
    assert torch.equal(mirrored.goals_xy_m, plain.goals_xy_m * LEFT)
    assert torch.equal(mirrored.targets, plain.targets * LEFT)
    assert torch.equal(mirrored.motion, plain.motion * signs)


def test_undisturbed_batch_is_what_was_recorded(show):
    shown, part, objective = show(motion="poses")
    plain = objective.plain(part.table, part.frames, SAMPLES)
    for name in ("images", "window", "motion", "goals_xy_m", "targets"):
        assert torch.equal(getattr(shown, name), getattr(plain, name)), name
    limits = np.array([1.0, 1.2], np.float32)
    assert np.allclose(shown.targets.numpy() * limits, part.table.targets[SAMPLES])


def test_images_are_numbers_from_minus_one_to_one_in_channels_last(show):
    images = show()[0].images
    assert images.is_contiguous(memory_format=torch.channels_last)
    assert (images.min(), images.max()) == (-1.0, 1.0)
    halves = show(torch.bfloat16)[0].images
    assert halves.dtype is torch.bfloat16
    assert torch.equal(halves, images.to(torch.bfloat16))


def test_previous_action_is_withheld_as_often_as_asked(show):
    assert (show(motion="command", previous_dropout=1.0)[0].motion == 0).all()
    shown, part, objective = show(motion="command")
    assert (shown.motion[:, 2] == 1).all()
    assert (objective.plain(part.table, part.frames, SAMPLES, withheld=True).motion == 0).all()


def test_loss_of_both_kinds_of_answers_is_least_at_the_target(show, source):
    for output in ("regression", "bins"):
        config = with_overrides(QUICK, output=output)
        shown, _, objective = show()
        bins = Bins(9, 17) if output == "bins" else None
        model = PolicyNet(source.robot, config.network)
        exact = shown.targets if bins is None else (bins.weights(shown.targets) + 1e-9).log()
        other = exact.roll(1, 0)
        least, more = (objective.loss(lambda *_, a=a: (a, a[:, :0]), bins, shown).item() for a in (exact, other))
        assert least < more
        assert math.isfinite(objective.loss(model, model.bins, shown).item())


def test_risks_are_mirrored_with_the_batch_and_not_told_of_turned_images(show, source):
    source.has_risks = True
    plain, mirrored = show()[0].risks, show(mirror=1.0)[0].risks
    assert {0, OBSTACLE, HUMAN} == set(plain.flatten().tolist())
    assert not torch.equal(plain, mirrored)
    assert torch.equal(mirrored, plain[:, torch.from_numpy(mirrored_commands())])
    assert (show(yaw_error_rad=0.2)[0].risks == UNKNOWN_RISK).all()


def test_risks_count_where_the_data_tell_them():
    risks = torch.tensor([[OBSTACLE, 0], [HUMAN, HUMAN], [UNKNOWN_RISK, UNKNOWN_RISK]], dtype=torch.uint8)
    right = torch.tensor([[9.0, -9, -9, -9], [-9, -9, 9, 9], [0, 0, 0, 0]])
    assert risks_loss(right, risks) < 1e-3
    assert risks_loss(-right, risks) > 5
    assert risks_loss(right, risks[2:].expand(3, 2)) == 0


def test_humans_count_where_there_are_any_and_the_data_say_so():
    truth = torch.tensor([[1.0, 0.3, 2.0], [0.0, 0.0, 0.0], [math.nan] * 3])
    right = torch.tensor([[9.0, 0.3, math.log(2.0)], [-9.0, 5.0, 5.0], [9.0, 1.0, 1.0]])
    assert humans_loss(right, truth) < 1e-3
    wrong = right.clone()
    wrong[0, 1] = 1.0
    assert humans_loss(wrong, truth) > 0.2
    assert humans_loss(right, torch.full((3, 3), math.nan)) == 0


@pytest.mark.parametrize("hindsight", [0.0, 1.0])
def test_each_sample_sees_the_picture_of_its_episodes_goal_or_in_hindsight_a_later_frame(source, hindsight):
    config = quick(**{**STILL, "goal": "both", "hindsight": hindsight})
    part = Part(source.robot, config, 1.0)
    for number, episode in enumerate(read_episodes(source)):
        goal = {"goal_image": (episode.images[number], *[b""] * (episode.sample_count - 1))}
        part.reservoir.add(dataclasses.replace(episode, outputs=goal))
    objective = Objective(source.robot, config, timing_of(source.robot, config), torch.float32)
    shown = objective.training(part.table, part.frames, SAMPLES, np.random.default_rng(0))
    seen = shown.images[shown.window[:, -1]].permute(0, 2, 3, 1).numpy()
    pictures = part.frames.get(part.table, own_goals(part.table, SAMPLES).seen_from) / 127.5 - 1
    same = np.isclose(seen, pictures, atol=1e-5).all(axis=(1, 2, 3))
    assert shown.window.shape == (len(SAMPLES), 4)
    assert same.all() if hindsight == 0.0 else same.mean() < 0.8
