import math

import pytest
import torch

from readygo.common.errors import PolicyError
from readygo.common.policy import load_policy
from readygo.services.trainer.config import CHECKPOINT_FILE
from readygo.services.trainer.parts import build_parts
from readygo.services.trainer.run import CANDIDATE_FOLDER, BudgetClock, TrainRun
from tests.services.trainer.conftest import QUICK, make_one, png, quick


@pytest.fixture
def make_run(source, tmp_path):
    def make(evaluate=None, evaluated="", **settings):
        config = quick(**settings)
        parts = build_parts(source, None, config)
        return TrainRun(
            parts, source.robot, source.sensor, config, tmp_path, data={}, evaluate=evaluate, evaluated=evaluated
        )

    return make


@pytest.mark.parametrize(("device", "spent_s"), [("cpu", 2.0), ("cuda", 30.0)])
def test_a_budget_is_processor_time_of_a_thread_and_on_a_gpu_time_that_goes_by(device, spent_s, make_run, monkeypatch):
    run = make_run(threads=4)
    run.learner.device = torch.device(device)
    monkeypatch.setattr("time.process_time", iter([100.0, 108.0]).__next__)
    monkeypatch.setattr("time.perf_counter", iter([50.0, 80.0]).__next__)
    with BudgetClock(run):
        pass
    assert run.elapsed_s == spent_s


def test_validations_come_after_equal_numbers_of_samples(make_run):
    run = make_run()
    run.go(lambda _: None)
    assert [entry["samples"] for entry in run.history] == [160, 320, 480, 640]
    assert all(math.isfinite(entry["train_loss"] + entry["validation_loss"]) for entry in run.history)


def test_weights_of_the_highest_success_rate_are_chosen(make_run, monkeypatch):
    monkeypatch.setattr("readygo.services.trainer.run.ROLLOUT_EVERY", 1)
    rates = iter([0.5, 0.75, 0.75, 0.5])

    def evaluate(folder):
        load_policy(folder)
        return next(rates)

    run = make_run(evaluate)
    run.go(lambda _: None)
    assert run.chosen_step == run.history[2]["step"]
    assert [entry["success_rate"] for entry in run.history] == [0.5, 0.75, 0.75, 0.5]
    assert (run.out / CANDIDATE_FOLDER).exists()


def test_loss_never_outranks_a_measured_success_rate(make_run, monkeypatch):
    monkeypatch.setattr("readygo.services.trainer.run.ROLLOUT_EVERY", 2)
    run = make_run(lambda _: 0.0)
    for _ in range(15):
        run.step()
    assert len(run.history) == 3
    assert run.chosen_step == run.history[1]["step"]


def test_last_weights_are_taken_where_nothing_was_measured(make_run):
    run = make_run()
    run.go(lambda _: None)
    assert run.chosen_step == run.steps == 20
    assert run.chosen_weights()["head.layer1.bias"].equal(run.learner.average.head.layer1.bias)


def test_loss_that_is_no_number_names_the_episodes_and_leaves_the_checkpoint(make_run):
    run = make_run()
    run.step()
    run.save()
    before = (run.out / "checkpoint.pt").read_bytes()
    goals = make_one("broken", samples=60).goals_xy_m * math.nan
    images = (png(torch.zeros(32, 64, 3, dtype=torch.uint8).numpy()),) * 60
    for name in list(run.training.reservoir.episodes):
        del run.training.reservoir.episodes[name]
    broken = make_one("broken", samples=60)
    run.training.reservoir.add(
        type(broken)(
            **{k: getattr(broken, k) for k in broken.__slots__}
            | {
                "goals_xy_m": goals,
                "images": images,
            }
        )
    )
    with pytest.raises(PolicyError, match=r"^The loss of step 1 is nan on episodes broken; the checkpoint in .*"):
        run.step()
    assert (run.out / "checkpoint.pt").read_bytes() == before


def test_weights_that_are_no_numbers_are_not_saved(make_run):
    run = make_run()
    run.save()
    before = (run.out / "checkpoint.pt").read_bytes()
    run.learner.model.head.layer1.weight.data[0, 0] = math.nan
    with pytest.raises(PolicyError, match="weights are not finite after step 0"):
        run.save()
    assert (run.out / "checkpoint.pt").read_bytes() == before


def test_loss_that_is_no_number_at_once_leaves_no_checkpoint_and_says_so(make_run):
    run = make_run(learning_rate=1e30)
    with pytest.raises(PolicyError, match=r"^The loss of step 1 is nan .*; there is no earlier checkpoint; continue"):
        run.go(lambda _: None)
    assert list(run.out.iterdir()) == []


def test_fall_that_is_begun_early_ends_the_run_early(make_run):
    run = make_run()
    for _ in range(8):
        run.step()
    run.schedule.begin_decay(run.fraction)
    run.go(lambda _: None)
    assert run.steps == 10
    assert run.learner.optimizer.param_groups[0]["lr"] < 0.6 * QUICK.optimizer.learning_rate
    assert run.progress().fraction == 1.0


@pytest.mark.parametrize(("spent", "steps"), [(9, 10), (10, 40)])
def test_early_fall_is_of_the_budget_in_which_it_was_begun(spent, steps, make_run):
    run = make_run()
    for step in range(spent):
        if step == 8:
            run.schedule.begin_decay(run.fraction)
        run.step()
    run.save()
    assert run.is_over == (spent == 10)
    more = make_run(samples=1280)
    more.go(lambda _: None)
    assert more.steps == steps


def test_early_fall_stays_with_the_same_budget_and_in_checkpoints_that_name_none(make_run):
    run = make_run()
    run.step()
    run.schedule.begin_decay(run.fraction)
    run.save()
    assert make_run(minutes=20.0).schedule.decay_from == run.schedule.decay_from
    without(run, "budget", "evaluated")
    assert make_run(samples=1280).schedule.decay_from == run.schedule.decay_from


def without(run, *names):
    """Make the checkpoint one of an earlier version."""
    state = torch.load(run.out / CHECKPOINT_FILE, weights_only=True)
    torch.save({name: value for name, value in state.items() if name not in names}, run.out / CHECKPOINT_FILE)


def test_last_weights_are_measured_in_closed_loop_also_where_they_are_validated_already(make_run):
    asked = []
    run = make_run(lambda folder: asked.append(folder) or 0.5)
    run.go(lambda _: None)
    assert len(asked) == 1
    assert [entry["samples"] for entry in run.history] == [160, 320, 480, 640]
    assert run.history[-1]["success_rate"] == 0.5
    assert run.chosen_step == run.steps
    make_run(lambda folder: asked.append(folder) or 0.5).go(lambda _: None)
    assert len(asked) == 1


def test_weights_chosen_in_other_episodes_are_dropped_and_those_of_the_same_ones_kept(make_run, monkeypatch):
    monkeypatch.setattr("readygo.services.trainer.run.ROLLOUT_EVERY", 2)
    rates = iter([0.9, 0.2])
    run = make_run(lambda _: next(rates), evaluated="one scene")
    run.go(lambda _: None)
    assert run.chosen_step == 10
    assert make_run(lambda _: 0.1, evaluated="one scene").chosen_step == 10
    other = make_run(lambda _: 0.1, evaluated="another scene")
    assert other.best == {}
    other.go(lambda _: None)
    assert (other.chosen_step, other.best["success_rate"]) == (20, 0.1)
    without(run, "budget", "evaluated")
    assert make_run(lambda _: 0.1, evaluated="one scene").best["success_rate"] == 0.1
