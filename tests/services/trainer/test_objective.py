import cmath
import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.common.camera.view import in_view, view_of
from readygo.common.dataset import Dataset
from readygo.common.messages import DriverKind
from readygo.common.robot.command_grid import HUMAN, OBSTACLE, UNKNOWN_RISK
from readygo.common.robot.command_grid import mirror_indices as mirrored_commands
from readygo.services.trainer import objective as objective_module
from readygo.services.trainer import views, with_overrides
from readygo.services.trainer.episodes import BODY_RADIUS_M, read_episodes
from readygo.services.trainer.goals import own_goals
from readygo.services.trainer.light import draw_light
from readygo.services.trainer.model import Bins, PolicyNet
from readygo.services.trainer.objective import Objective, humans_loss, risks_loss
from readygo.services.trainer.parts import EpisodePart, build_parts, timing_of
from readygo.services.trainer.views import BatchViews
from tests.crooked import ODD_RATES, TWINS, crooked_episode, write_crooked_shard
from tests.services.trainer.conftest import QUICK, quick

LEFT = torch.tensor([1.0, -1.0])
SAMPLES = np.arange(3, 120, 7)


@pytest.fixture(autouse=True)
def _undisturbed(monkeypatch):
    for module, name in (
        (views, "MIRRORED"),
        (views, "PHOTOMETRIC"),
        (objective_module, "PREVIOUS_NOISE"),
        (objective_module, "PREVIOUS_DROPOUT"),
    ):
        monkeypatch.setattr(module, name, 0.0)


@pytest.fixture
def show(source):
    """What the network is shown in training."""

    def shown(dtype=torch.float32, **settings):
        config = quick(**{"network": QUICK.network, "hindsight": 0.0, **settings})
        part = build_parts(source, None, config)[0]
        objective = Objective(source.robot, config, timing_of(source.robot, config), dtype)
        return objective.training(part.table, part.frames, SAMPLES, np.random.default_rng(0)), part, objective

    return shown


@pytest.mark.parametrize("motion", ["poses", "command"])
def test_mirrored_batch_is_the_flipped_image_with_goal_motion_and_turns_to_the_other_side(show, motion, monkeypatch):
    plain = show(motion=motion)[0]
    monkeypatch.setattr(views, "MIRRORED", 1.0)
    mirrored = show(motion=motion)[0]
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


def test_previous_action_is_withheld_as_often_as_asked(show, monkeypatch):
    shown, part, objective = show(motion="command")
    assert (shown.motion[:, 2] == 1).all()
    assert (objective.plain(part.table, part.frames, SAMPLES, withheld=True).motion == 0).all()
    monkeypatch.setattr(objective_module, "PREVIOUS_DROPOUT", 1.0)
    assert (show(motion="command")[0].motion == 0).all()


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


def test_risks_are_mirrored_with_the_batch_and_not_told_of_turned_images(show, source, monkeypatch):
    source.has_risks = True
    plain = show()[0].risks
    monkeypatch.setattr(views, "MIRRORED", 1.0)
    mirrored = show()[0].risks
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
    config = quick(**{"goal": "both", "hindsight": hindsight})
    part = EpisodePart(source.robot, config, 1.0)
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


EPISODES = (3, 8)
CROOKED = {
    "crooked": dataclasses.replace(TWINS, cameras={}),
    "odd": dataclasses.replace(ODD_RATES, camera=TWINS.camera, cameras={}),
}
AHEAD_S = 0.1


@pytest.fixture(scope="module", params=CROOKED)
def crooked(request, tmp_path_factory):
    """Recorded episodes of a crooked robot, and what is shown of them in a given view."""
    robot, folder = CROOKED[request.param], tmp_path_factory.mktemp("data")
    changes = {"driver": DriverKind.EXPERT, "policy": "", "cameras": ()}
    write_crooked_shard(folder, EPISODES, 60, robot=robot, **changes)
    config = quick(hindsight=0.0, motion="poses", ahead_s=AHEAD_S, frame_spacing_s=0.2, humans_weight=0.4)
    part = EpisodePart(robot, config, 1.0)
    for episode in read_episodes(Dataset(folder), with_humans=True):
        part.reservoir.add(episode)
    objective = Objective(robot, config, timing_of(robot, config), torch.float32)
    recorded = [crooked_episode(index, 60, robot=robot, **changes) for index in EPISODES]
    table = part.table
    samples = table.usable_samples[3::5]

    def show(yaws_rad, mirrored):
        view = BatchViews(
            yaws_rad=np.array(yaws_rad), shifts_px=np.zeros((2, 2), np.int64), mirrored=np.array(mirrored),
            light=draw_light(2, 0.0, np.random.default_rng(0)),
        )  # fmt: skip
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(objective_module, "draw_views", lambda *_, **__: view)
            return objective.training(table, part.frames, samples, np.random.default_rng(0))

    return SimpleNamespace(robot=robot, config=config, recorded=recorded, samples=samples, show=show, table=table)


def place(pose_xyzyaw, xy_m):
    """A place of the world in a robot's frame, as a complex number: x + i y."""
    x, y, _, yaw_rad = pose_xyzyaw
    return (complex(*xy_m) - complex(x, y)) * cmath.exp(-1j * yaw_rad)


def is_shown(robot, z):
    """Whether the camera shows a human at a place in the robot's frame."""
    return in_view(robot.camera.eye(0.0, 0.0, 0.0), z.real, z.imag, view_of(robot.camera), math.inf, BODY_RADIUS_M)


def expected_numbers(recorded, robot, seq, yaw_rad, mirrored):
    """What is told of a sample, from what was recorded, by turning and mirroring complex numbers."""
    header, all_samples = recorded
    sample, clock = all_samples[seq], robot.clock
    turned = cmath.exp(-1j * yaw_rad)
    flip = (lambda z: z.conjugate()) if mirrored else (lambda z: z)
    side = -1.0 if mirrored else 1.0
    goal = flip(place(sample.robot_xyzyaw, header.goal_xy_m) * turned)
    steps = round(AHEAD_S * clock.rate_hz) + clock.control_every - 1
    v_mps, w_radps = sample.expert_commands[min(steps, len(sample.expert_commands) - 1)]
    if yaw_rad != 0:
        w_radps = min(max(w_radps - 2.0 * yaw_rad, -robot.w_max_radps), robot.w_max_radps)
    motion = []
    for frames_ago in (2, 1):
        seen = max(0, seq // clock.image_every * clock.image_every - frames_ago * round(0.2 * clock.rate_hz))
        older = all_samples[seen].robot_xyzyaw
        moved = flip(place(sample.robot_xyzyaw, older[:2]) * turned)
        motion += [moved.real, moved.imag, side * (older[3] - sample.robot_xyzyaw[3])]
    before = all_samples[seq - 1]
    motion += [before.action_v_mps, side * before.action_w_radps]
    humans = (0.0, side * -yaw_rad, 0.0)
    if sample.human_visible:
        seen = [place(sample.robot_xyzyaw, human[:2]) for human in sample.humans_xyzyaw]
        seen = [z for z in seen if is_shown(robot, z)]
        if seen:
            nearest = flip(min(seen, key=abs) * turned)
            humans = (1.0, cmath.phase(nearest), abs(nearest))
            if yaw_rad != 0 and not is_shown(robot, min(seen, key=abs) * turned):
                humans = (math.nan,) * 3
    return {
        "goals_xy_m": (goal.real, goal.imag),
        "targets": (v_mps / robot.v_max_mps, side * w_radps / robot.w_max_radps),
        "motion": motion,
        "humans": humans,
    }


@settings(max_examples=20, deadline=None)
@given(
    yaws_rad=st.tuples(*[st.one_of(st.just(0.0), st.floats(0.05, 0.3), st.floats(-0.3, -0.05))] * 2),
    mirrored=st.tuples(st.booleans(), st.booleans()),
)
def test_every_number_is_that_of_the_turned_and_mirrored_robot(crooked, yaws_rad, mirrored):
    shown = crooked.show(yaws_rad, mirrored)
    for row, sample in enumerate(crooked.samples.tolist()):
        episode = int(crooked.table.episode[sample])
        seq = sample - int(crooked.table.first[sample])
        expected = expected_numbers(crooked.recorded[episode], crooked.robot, seq, yaws_rad[episode], mirrored[episode])
        for name, numbers in expected.items():
            assert getattr(shown, name)[row].tolist() == pytest.approx(numbers, abs=2e-5, nan_ok=True), name


def test_samples_of_held_commands_are_those_at_which_the_robot_is_commanded(crooked):
    clock = crooked.robot.clock
    steps = crooked.table.usable_samples - crooked.table.first[crooked.table.usable_samples]
    wanted = [step for step in range(60) if step % clock.control_every == 0 and step % clock.image_every == 0]
    assert sorted(set(steps.tolist())) == wanted


def test_mirrored_twice_and_turned_back_is_what_was_recorded(crooked):
    plain = crooked.show((0.0, 0.0), (False, False))
    mirrored = crooked.show((0.0, 0.0), (True, True))
    turned = crooked.show((0.2, -0.2), (False, False))
    assert torch.equal(mirrored.images.flip(3), plain.images)
    assert torch.equal(mirrored.risks[:, torch.from_numpy(mirrored_commands(crooked.robot))], plain.risks)
    for name, signs in (("goals_xy_m", [1, -1]), ("targets", [1, -1]), ("humans", [1, -1, 1])):
        assert torch.equal(getattr(mirrored, name) * torch.tensor(signs), getattr(plain, name)), name
    assert not torch.equal(turned.images, plain.images)
    assert torch.equal(turned.window, plain.window)
    assert torch.equal(turned.traits, plain.traits)


def test_pictures_of_goals_are_not_turned_with_the_robot(source, monkeypatch):
    config = quick(hindsight=0.0, goal="both")
    part = EpisodePart(source.robot, config, 1.0)
    for number, episode in enumerate(read_episodes(source)):
        goal = {"goal_image": (episode.images[number + 3], *[b""] * (episode.sample_count - 1))}
        part.reservoir.add(dataclasses.replace(episode, outputs=goal))
    objective = Objective(source.robot, config, timing_of(source.robot, config), torch.float32)

    def show(yaw_rad):
        def views(turnable, *_, mirrors):
            count = len(turnable)
            return BatchViews(
                yaws_rad=np.full(count, yaw_rad), shifts_px=np.tile([2, -3], (count, 1)),
                mirrored=np.arange(count) % 2 == 0, light=draw_light(count, 0.2, np.random.default_rng(3)),
            )  # fmt: skip

        monkeypatch.setattr(objective_module, "draw_views", views)
        shown = objective.training(part.table, part.frames, SAMPLES, np.random.default_rng(0))
        return shown.images[shown.window[:, :-1]], shown.images[shown.window[:, -1]]

    (frames, goals), (turned_frames, turned_goals) = show(0.0), show(0.25)
    assert torch.equal(turned_goals, goals)
    assert not torch.equal(turned_frames, frames)


def humans_reference(answers, humans):
    """Mean cross-entropy of presence, and smooth L1 of bearing and log distance, by sample that tells."""
    presence, places, count = 0.0, 0.0, 0
    for (logit, bearing, log_m), (there, bearing_rad, distance_m) in zip(answers, humans, strict=True):
        if math.isnan(there):
            continue
        count += 1
        presence += math.log1p(math.exp(-abs(logit))) + max(logit, 0.0) - logit * there
        if there > 0.5:
            for off in (abs(bearing - bearing_rad), abs(log_m - math.log(distance_m))):
                places += 0.5 * off * off / 0.1 if off < 0.1 else off - 0.05
    return (presence + places) / count


def risks_reference(logits, risks):
    """Mean cross-entropy over the commands of the samples that tell, for obstacles and for humans."""
    losses = []
    for row, told in zip(logits, risks, strict=True):
        if told[0] == UNKNOWN_RISK:
            continue
        truths = [float(risk == kind) for kind in (OBSTACLE, HUMAN) for risk in told]
        losses += [math.log1p(math.exp(-abs(z))) + max(z, 0.0) - z * t for z, t in zip(row, truths, strict=True)]
    return sum(losses) / len(losses)


@settings(deadline=None)
@given(seed=st.integers(0, 2**31))
def test_losses_are_those_of_a_plain_reference(seed):
    rng = np.random.default_rng(seed)
    answers = rng.normal(size=(6, 3)) * 2
    humans = np.stack([[1, 1, 0, 0, 1, np.nan], rng.normal(size=6), rng.uniform(0.4, 6, 6)], axis=1)
    humans[humans[:, 0] == 0] = 0.0
    answers[0, 1:] = humans[0, 1] + 0.03, math.log(humans[0, 2]) - 0.06
    loss = humans_loss(torch.tensor(answers), torch.tensor(humans)).item()
    assert loss == pytest.approx(humans_reference(answers.tolist(), humans.tolist()), rel=1e-6)
    logits, risks = rng.normal(size=(4, 10)) * 3, rng.integers(0, 3, (4, 5))
    risks[2] = UNKNOWN_RISK
    loss = risks_loss(torch.tensor(logits), torch.tensor(risks, dtype=torch.uint8)).item()
    assert loss == pytest.approx(risks_reference(logits.tolist(), risks.tolist()), rel=1e-6)


@pytest.mark.parametrize("output", ["regression", "bins", "weighed"])
def test_loss_is_the_weighted_sum_of_its_parts(crooked, output):
    shown = crooked.show((0.0, 0.0), (False, True))
    config = with_overrides(crooked.config, output=output, risks_weight=0.7, humans_weight=0.3)
    bins = PolicyNet(crooked.robot, config.network).bins
    rng = np.random.default_rng(1)
    commands = shown.risks.shape[1]
    count = {"regression": 2, "bins": 0 if bins is None else len(bins.centres), "weighed": 3 * commands}[output]
    answers, humans = (torch.tensor(rng.normal(size=(len(shown.targets), n)), dtype=torch.float32) for n in (count, 3))
    objective = Objective(crooked.robot, config, timing_of(crooked.robot, config), torch.float32)
    loss = objective.loss(lambda *_: (answers, humans), bins, shown).item()
    if output == "regression":
        expected = float(np.mean((answers.numpy() - shown.targets.numpy()) ** 2))
    else:
        choice = answers[:, : len(bins.centres)].double().numpy()
        shares = choice - np.log(np.exp(choice).sum(axis=1, keepdims=True))
        expected = float(-(bins.weights(shown.targets).numpy() * shares).sum(axis=1).mean())
    if output == "weighed":
        expected += 0.7 * risks_reference(answers[:, commands:].tolist(), shown.risks.tolist())
    expected += 0.3 * humans_reference(humans.tolist(), shown.humans.tolist())
    assert loss == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("yaw_rad", "taught"), [(0.0, [True, True]), (0.2, [True, False]), (-0.2, [False, True])])
def test_human_who_is_turned_out_of_the_image_is_not_taught(crooked, yaw_rad, taught):
    # One at the left border of the view, one at the right border.
    left_rad = view_of(crooked.robot.camera).left_rad
    places = np.array([[1.0, left_rad - 0.01, 3.0], [1.0, 0.01 - left_rad, 3.0]], np.float32)
    with pytest.MonkeyPatch.context() as patch:
        humans = crooked.table.humans.copy()
        humans[crooked.samples[:2]] = places
        patch.setitem(crooked.table.__dict__, "humans", humans)
        shown = crooked.show((yaw_rad, yaw_rad), (False, False)).humans[:2].numpy()
    assert np.isfinite(shown).all(axis=1).tolist() == taught
    assert np.allclose(shown[taught], (places - [0, yaw_rad, 0])[taught])
