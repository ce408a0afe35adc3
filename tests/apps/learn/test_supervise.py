"""The supervisor with stand-ins for the processes, the measurements and the clock."""

import dataclasses
import errno
import json
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.learn import supervise
from readygo.apps.learn.choice import PolicyMeasurement
from readygo.apps.learn.config import LearnConfig
from readygo.apps.learn.cores import CoreSplit
from readygo.apps.learn.measure import Measured
from readygo.apps.learn.plan import Budget, LearnPlan, learn_settings, make_plan, read_state
from readygo.apps.learn.supervise import Supervisor
from readygo.apps.learn.training import DECAY_FILE, PROGRESS_FILE
from readygo.common.errors import RunError
from readygo.common.policy import load_policy, load_spec
from readygo.runs.origin import origin_of_policy
from readygo.runs.policy import policy_sha256
from tests.common.policy.artifacts import write_policy

MINUTES = 2.0
TICK_S = 1.0


class Clock:
    """A tick a second, whatever it really takes."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += TICK_S
        time.sleep(0.002)


class StandInCrew:
    """A fleet that records 100 images a tick, and a trainer that learns 800 and offers a policy every 6 ticks."""

    made: "list[StandInCrew]" = []  # noqa: RUF012
    learns = True
    dies_after = 10**9

    def __init__(self, plan: LearnPlan, split: CoreSplit, reach: object) -> None:
        self.plan, self.running, self.splits = plan, split, []
        self.samples = self.images = self.policies = self.ticks = self.fell = 0
        self.collect_hz, self.status = 100.0, {}
        self.made.append(self)

    def __enter__(self) -> "StandInCrew":
        return self

    def __exit__(self, *_: object) -> None:
        if self.learns:
            write_policy(self.plan.policy)

    def pace(self, wanted: bool) -> None:
        self.paused = not wanted

    def split(self, split: CoreSplit) -> None:
        self.splits.append(split)

    def check(self, training: object) -> None:
        self.ticks += 1
        if self.ticks > self.dies_after:
            raise KeyboardInterrupt
        self.samples += 500
        self.images += 100
        self.fell += (self.plan.policy / DECAY_FILE).exists()
        if self.learns:
            self._train()

    def _train(self) -> None:
        folder = self.plan.policy / "candidates" / f"{self.ticks:07d}"
        if self.ticks % 6 == 0:
            shutil.copytree(self._policy(), folder)
            self.policies += 1
        offers = [{"folder": f"candidates/{n:07d}", "sha256": f"{n}"} for n in range(6, self.ticks + 1, 6)]
        ended = self.fell > 10
        told = {
            "state": "ended" if ended else "training",
            "fraction": 1.0 if ended else 0.5,
            "minutes": self.ticks / 60,
            "samples": 800 * self.ticks,
            "success": {},
            "offers": offers,
            "history": [{"train_loss": 1 / self.ticks}],
        }
        (self.plan.policy / PROGRESS_FILE).write_text(json.dumps(told))

    def _policy(self) -> Path:
        return write_policy(self.plan.out / "newest")


class StandInMeasuring:
    """Success rates by the order in which they are asked for; the last one stays."""

    def __init__(self, rates: list[float]) -> None:
        self.rates, self.asked, self.episodes = rates, [], []

    def val(self, folder: Path, sha256: str, episodes: int, fraction: float, **_: object) -> Measured:
        rate = self.rates[min(len(self.asked), len(self.rates) - 1)]
        self.asked.append((sha256, fraction))
        self.episodes.append(episodes)
        measurement = PolicyMeasurement(fraction=fraction, policy=sha256, episodes=20, static=rate, dynamic=rate)
        return Measured(measurement=measurement, folder=folder, episode_s=0.5)


@pytest.fixture
def plan(tmp_path: Path) -> Callable[..., LearnPlan]:
    def made(minutes: float = MINUTES, **learn: float) -> LearnPlan:
        settings, budget = learn_settings(None, None), Budget(minutes=minutes)
        out = tmp_path / "run"
        return make_plan(("embedded",), out, settings, LearnConfig(**learn), budget, avatars=None, seed=0)

    return made


@pytest.fixture(autouse=True)
def crew(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type[StandInCrew]:
    # File systems tell the time a little late.
    clock, begun_s = Clock(), time.time() - 0.1
    monkeypatch.setattr(
        supervise, "time", SimpleNamespace(monotonic=clock.monotonic, sleep=clock.sleep, time=lambda: begun_s)
    )
    monkeypatch.setattr(supervise, "Crew", StandInCrew)
    monkeypatch.setattr(supervise, "available_cores", lambda: 2)
    monkeypatch.setattr(StandInCrew, "made", [])
    (tmp_path / "run").mkdir()
    return StandInCrew


def learn(plan: LearnPlan, rates: list[float]) -> tuple[Supervisor, StandInMeasuring, PolicyMeasurement | None]:
    measuring = StandInMeasuring(rates)
    supervisor = Supervisor(plan, measuring, lambda now: None)
    return supervisor, measuring, supervisor.learn()


def test_policies_are_measured_as_it_goes_and_the_best_one_is_left(plan: Callable[..., LearnPlan]) -> None:
    _, measuring, chosen = learn(plan(), [0.2, 0.9, 0.4])
    apart = [later[1] - earlier[1] for earlier, later in zip(measuring.asked, measuring.asked[1:], strict=False)]
    assert len(measuring.asked) >= 5
    assert min(apart[:-1]) >= 0.1
    assert chosen is not None
    assert (chosen.static, chosen.policy) == (0.9, measuring.asked[1][0])
    origin = origin_of_policy(load_spec(plan().policy))
    assert origin is not None
    assert set(origin.scenes.values()) == {"embedded"}
    assert plan().best.is_dir()


@pytest.mark.parametrize(("rate", "kept"), [(0.95, True), (0.5, False)])
def test_policy_that_learned_elsewhere_is_kept_if_it_is_better(
    plan: Callable[..., LearnPlan], rate: float, kept: bool, tmp_path: Path
) -> None:
    supervisor, measuring, _ = learn(plan(minutes=8.0), [0.7])
    other = write_policy(tmp_path / "other", seed=1)
    measuring.rates, asked = [rate], len(measuring.asked)
    for _ in range(2):
        found = supervisor.take(other)
        assert found is not None
        assert found.static == max(rate, 0.7)
        assert (found.policy == policy_sha256(other)) == kept
        weights = (plan().policy / "policy.onnx").read_bytes()
        assert (weights == (other / "policy.onnx").read_bytes()) == kept
        assert origin_of_policy(load_spec(plan().policy)) is not None
    assert measuring.asked[asked:] == [(policy_sha256(other), 1.0)]
    assert supervise.VAL_EPISODES_MAX == measuring.episodes[-2] < measuring.episodes[-1] < supervise.TAKEN_EPISODES_MAX
    again, _, resumed = learn(plan(minutes=8.0), [0.1])
    assert resumed == found
    assert again.measurements == supervisor.measurements
    state = json.loads(plan().state_file.read_text())
    plan().state_file.write_text(json.dumps(state | {"spent_s": state["spent_s"] - 0.1}))
    late, _, _ = learn(plan(minutes=8.0), [0.1])
    late.take(write_policy(tmp_path / "third", seed=2))
    assert late.points[-1].minutes == late.points[-2].minutes


def test_rate_falls_in_time_for_the_budget_and_the_time_is_written_down(plan: Callable[..., LearnPlan]) -> None:
    supervisor, _, _ = learn(plan(), [0.5])
    assert 0.8 * MINUTES < supervisor.minutes <= 1.1 * MINUTES
    state = read_state(plan())
    assert state["spent_s"] == pytest.approx(60 * supervisor.minutes, abs=0.1)
    assert state["over"] == {"minutes": MINUTES, "samples": None}


def test_it_ends_early_when_the_rate_does_not_rise(plan: Callable[..., LearnPlan]) -> None:
    patient, _, _ = learn(plan(minutes=4.0, patience=0.3), [0.9, 0.1])
    assert patient.minutes < 0.8 * 4.0


def test_interrupted_run_goes_on_with_the_time_that_is_left(
    plan: Callable[..., LearnPlan], crew: type[StandInCrew], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StandInCrew, "dies_after", 60)
    with pytest.raises(KeyboardInterrupt):
        learn(plan(), [0.5])
    spent_s = read_state(plan())["spent_s"]
    assert spent_s == 60
    monkeypatch.setattr(StandInCrew, "dies_after", 10**9)
    shutil.rmtree(plan().policy / "candidates")
    supervisor, _, _ = learn(plan(), [0.5])
    assert supervisor.minutes <= 1.1 * MINUTES
    assert crew.made[-1].ticks < 1.1 * 60 * MINUTES - spent_s + 5
    assert [point.minutes for point in supervisor.points] == sorted(point.minutes for point in supervisor.points)


def test_run_that_is_over_is_not_begun_again_unless_there_is_more_time(
    plan: Callable[..., LearnPlan], crew: type[StandInCrew]
) -> None:
    learn(plan(), [0.5])
    _, _, chosen = learn(plan(), [0.5])
    assert len(crew.made) == 1
    assert chosen is not None
    shutil.rmtree(plan().policy / "candidates")
    os.utime(plan().policy / PROGRESS_FILE, (0, 0))
    learn(plan(minutes=2 * MINUTES), [0.5])
    assert len(crew.made) == 2
    assert crew.made[1].ticks > 0.5 * 60 * MINUTES, "that the earlier trainer had ended says nothing"


def test_run_with_more_time_is_measured_over_the_rest_of_the_larger_budget(plan: Callable[..., LearnPlan]) -> None:
    learn(plan(), [0.5])
    shutil.rmtree(plan().policy / "candidates")
    os.utime(plan().policy / PROGRESS_FILE, (0, 0))
    supervisor, measuring, chosen = learn(plan(minutes=2 * MINUTES), [0.6, 0.9, 0.4])
    fractions = [fraction for _, fraction in measuring.asked]
    assert len(fractions) >= 4
    assert 0.5 < fractions[0] < 0.8
    assert chosen is not None
    assert chosen.policy == measuring.asked[1][0]
    done = [measurement.fraction for measurement in supervisor.measurements]
    assert done == sorted(done)
    assert done[-len(fractions) - 1] == pytest.approx(0.5, abs=0.06)


def test_shares_of_an_earlier_budget_are_read_as_those_of_the_present_one(plan: Callable[..., LearnPlan]) -> None:
    learn(plan(), [0.5])
    same = Supervisor(plan(), StandInMeasuring([0.5]), lambda now: None).measurements
    assert same[-1].fraction == 1.0
    more = dataclasses.replace(plan(), budget=Budget(minutes=MINUTES, samples=400_000))
    points = [point for point in Supervisor(more, StandInMeasuring([0.5]), lambda now: None).points]
    found = [point for point in points if point.measurement is not None]
    assert [point.measurement.fraction for point in found] == [point.learned / 400_000 for point in found]
    state = json.loads(plan().state_file.read_text())
    # Folders of earlier versions name the budget of a run that is over only.
    plan().state_file.write_text(json.dumps({name: value for name, value in state.items() if name != "budget"}))
    assert Supervisor(plan(), StandInMeasuring([0.5]), lambda now: None).measurements == same
    longer = Supervisor(plan(minutes=2 * MINUTES), StandInMeasuring([0.5]), lambda now: None)
    assert longer.measurements[-1].fraction == pytest.approx(longer.minutes / (2 * MINUTES))


def test_run_that_is_interrupted_in_its_extension_keeps_the_shares_of_the_larger_budget(
    plan: Callable[..., LearnPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    learn(plan(), [0.5])
    os.utime(plan().policy / PROGRESS_FILE, (0, 0))
    monkeypatch.setattr(StandInCrew, "dies_after", 0)
    with pytest.raises(KeyboardInterrupt):
        learn(plan(minutes=2 * MINUTES), [0.5])
    again = Supervisor(plan(minutes=2 * MINUTES), StandInMeasuring([0.5]), lambda now: None)
    assert again.measurements[-1].fraction == pytest.approx(again.minutes / (2 * MINUTES), abs=0.01)


def test_cores_are_split_by_what_was_measured_once(
    plan: Callable[..., LearnPlan], crew: type[StandInCrew], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervise, "available_cores", lambda: 12)
    learn(plan(), [0.5])
    # Six threads learn 800 samples per second of each one's time together.
    assert crew.made[0].running == CoreSplit(6, 6)
    assert crew.made[0].splits == [CoreSplit(3, 9)]
    assert read_state(plan())["split"] == {"collectors": 3, "trainer_threads": 9}


@pytest.mark.parametrize("file", ["curve.json", "learn.json", "policy.onnx"])
def test_full_disk_is_one_line_and_with_room_it_goes_on(
    plan: Callable[..., LearnPlan], file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, data: bytes) -> int:
        if path.parent.name.startswith(f".{Path(file).stem}-") and path.suffix == Path(file).suffix:
            with path.open("wb") as half:
                half.write(data[:10])
            raise OSError(errno.ENOSPC, "No space left on device")
        return write_bytes(path, data)

    write_bytes = Path.write_bytes
    made = plan()
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(RunError, match=rf"{file} cannot be written: No space left on device\.$"):
        learn(made, [0.5])
    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    shutil.rmtree(made.policy / "candidates", ignore_errors=True)
    _, _, chosen = learn(plan(), [0.5])
    assert chosen is not None
    load_policy(made.policy)
    assert not [path for path in made.out.rglob(".*") if path.name not in (".lock", ".readygo")]


def test_policy_that_is_half_copied_is_none(plan: Callable[..., LearnPlan], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(source: Path, target: Path) -> None:
        target.write_bytes(source.read_bytes()[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(supervise, "shutil", SimpleNamespace(copyfile=full, rmtree=shutil.rmtree))
    with pytest.raises(RunError, match=r"best cannot be written: No space left on device\.$"):
        learn(plan(), [0.5])
    assert not plan().best.exists()


def test_nothing_learned_is_one_line(plan: Callable[..., LearnPlan], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StandInCrew, "learns", False)
    with pytest.raises(RunError, match=r"^Nothing was learned in 2\.2 min: the trainer saw too few episodes"):
        learn(plan(), [0.5])
