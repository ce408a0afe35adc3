"""The crew with stand-ins for fleets, buses and router."""

import dataclasses
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.learn import crew as crew_module
from readygo.apps.learn.config import LearnConfig
from readygo.apps.learn.cores import CoreSplit
from readygo.apps.learn.crew import DEAF_MAX, FROZEN_S, PACE_S, Crew, Reach
from readygo.apps.learn.plan import Budget, LearnPlan, learn_settings, make_plan
from readygo.apps.learn.training import Training
from readygo.common.bus import Member
from readygo.common.errors import BusError, RunError
from readygo.common.messages import Command, StatusReply
from readygo.runs.folder import RunFolder

NOW = Training(told_s=time.time())


class StandInFleet:
    """Notes who is in it."""

    made: "list[StandInFleet]" = []  # noqa: RUF012

    def __init__(self, *, connect: str, run: str, data: object, logs: Path, certs: Path | None, forks: object) -> None:
        self.shown = connect, certs
        self.run, self.members, self.checks, self.stopped, self.begun = run, [], 0, False, 0
        self.killed: list[str] = []
        self.made.append(self)

    def add(self, role: str, name: str, *arguments: str) -> None:
        self.members.append(SimpleNamespace(role=role, name=name, arguments=arguments))
        self.begun += 1

    def remove(self, name: str) -> None:
        self.members = [member for member in self.members if member.name != name]

    def check(self) -> None:
        self.checks += 1

    def kill(self, role: str) -> None:
        self.killed.append(role)

    def check_recorders(self) -> None:
        assert self.stopped

    def stop(self) -> None:
        self.stopped = True

    def names(self, role: str) -> list[str]:
        return [member.name for member in self.members if member.role == role]


class StandInBus:
    """Notes what an operator commands."""

    commands: "list[Command]" = []  # noqa: RUF012
    deaf = False

    def __init__(self, connect: str, run: str, role: str, *, certs: Path | None, token: str) -> None: ...

    def announce(self, role: str, name: str) -> None: ...

    def subscribe(self, stream: object, handler: object) -> None: ...

    def watch(self, changed: object) -> None: ...

    def request(self, topic: object, request: object, *, timeout_s: float) -> None:
        if self.deaf:
            raise BusError("nobody answers")
        self.commands.append(request.command)

    def close(self) -> None: ...


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LearnPlan:
    monkeypatch.setattr(StandInFleet, "made", [])
    monkeypatch.setattr(StandInBus, "commands", [])
    monkeypatch.setattr(crew_module, "Fleet", StandInFleet)
    monkeypatch.setattr(crew_module, "join", StandInBus)
    monkeypatch.setattr(crew_module, "LOOK_S", 0.0)
    monkeypatch.setattr(crew_module, "open_router", lambda *given, **named: SimpleNamespace(close=lambda: None))
    (tmp_path / "run").mkdir()
    settings, budget = learn_settings(None, None), Budget(minutes=1.0)
    plan = make_plan(("embedded",), tmp_path / "run", settings, LearnConfig(), budget, avatars=None, seed=0)
    first = plan.places[0]
    spec, folder = dataclasses.replace(first.spec, run="run-2"), RunFolder(tmp_path / "other")
    other = dataclasses.replace(first, name="embedded-2", spec=spec, folder=folder)
    return dataclasses.replace(plan, places=(first, other))


def status(**changes: object) -> StatusReply:
    counts = {"waiting": {}, "leased": {}, "rejected": {}, "requeued": 0, "cpu_s": {"drive": 2.0, "animate": 0.5}}
    plain = {"wanted": 9, "committed": 2, "samples": 300, "finished": False, "policies": 3, **counts}
    return StatusReply(**{**plain, **changes})


def test_every_scene_has_a_fleet_and_all_have_one_trainer(plan: LearnPlan) -> None:
    with Crew(plan, CoreSplit(3, 2)):
        first, second, trainer = StandInFleet.made
        assert (first.names("all"), second.names("all")) == (["all0", "all1"], ["all0"])
        assert first.names("coordinator") == ["coordinator"]
        assert trainer.names("trainer") == ["trainer"]
        assert trainer.run == ",".join(place.spec.run for place in plan.places)
        assert "threads = 2" in (plan.out / "trainer.toml").read_text()
    assert all(fleet.stopped for fleet in StandInFleet.made)


def test_workers_of_other_hosts_collect_and_are_told_when_it_is_over(plan: LearnPlan, tmp_path: Path) -> None:
    with Crew(plan, CoreSplit(0, 2), Reach(listen="tls/0.0.0.0:7447", certs=tmp_path, hosts=True)):
        assert [fleet.names("all") for fleet in StandInFleet.made] == [[], [], []]
        assert {fleet.shown for fleet in StandInFleet.made} == {("tls/127.0.0.1:7447", tmp_path)}
    assert StandInBus.commands == [Command.CANCEL, Command.CANCEL]


def test_guests_are_given_time_to_finish_their_episodes_unless_it_is_stopped(
    plan: LearnPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    listening = partial(Crew, plan, CoreSplit(2, 1), Reach(listen="tls/lab1:7447", certs=Path("certs"), hosts=True))
    place = plan.places[0].name
    with listening() as crew:
        crew._note_presence(place, Member("all", "all0", "s"), True)
        crew._note_presence(place, Member("recorder", "rec0", "s"), True)
    looks = iter(range(3))

    def look(_: float) -> None:
        if next(looks) == 2:
            crew._note_presence(place, Member("all", "guest", "s"), False)

    with monkeypatch.context() as patched:
        patched.setattr(crew_module.time, "sleep", look)
        with listening() as crew:
            crew._note_presence(place, Member("all", "guest", "s"), True)
    assert next(looks, None) is None
    monkeypatch.setattr(crew_module, "STOP_S", 0.0)
    with pytest.raises(KeyboardInterrupt), listening() as crew:  # noqa: PT012
        crew._note_presence(place, Member("all", "guest", "s"), True)
        raise KeyboardInterrupt


def test_numbers_are_those_of_all_scenes_and_images_are_counted_apart(plan: LearnPlan) -> None:
    with Crew(plan, CoreSplit(2, 1)) as crew:
        assert (crew.samples, crew.images, crew.policies, crew.collect_hz) == (0, 0, 0, 0.0)
        crew.status = {"embedded": status(), "embedded-2": status(samples=200, policies=2)}
        assert (crew.samples, crew.images, crew.policies, crew.collect_hz) == (500, 100, 3, 20.0)


def test_run_that_cannot_go_on_ends_it_all_and_one_that_is_finished_rests(plan: LearnPlan) -> None:
    with Crew(plan, CoreSplit(2, 1)) as crew:
        crew.status = {"embedded": status(finished=True)}
        crew.check(NOW)
        first, second, trainer = StandInFleet.made
        assert (first.checks, second.checks, trainer.checks) == (0, 1, 1)
        crew.check(Training(told_s=NOW.told_s, ended=True))
        assert (second.checks, trainer.checks) == (2, 1)
        crew.status["embedded-2"] = status(failed="No space left on device.")
        with pytest.raises(RunError, match=r"^Scene embedded-2: No space left on device\.$"):
            crew.check(NOW)


def test_frozen_trainer_is_started_anew(plan: LearnPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    with Crew(plan, CoreSplit(2, 1)) as crew:
        trainer = StandInFleet.made[-1]
        crew.check(NOW)
        assert trainer.begun == 1
        later_s = time.time() + FROZEN_S + 1
        monkeypatch.setattr(crew_module, "time", SimpleNamespace(time=lambda: later_s))
        crew.check(NOW)
        assert (trainer.begun, trainer.names("trainer")) == (2, ["trainer"])
        crew.check(NOW)
        assert trainer.begun == 2, "it gets time to begin"


def test_cores_are_split_in_another_way_while_it_runs(plan: LearnPlan) -> None:
    with Crew(plan, CoreSplit(4, 4)) as crew:
        first, second, trainer = StandInFleet.made
        crew.split(CoreSplit(3, 4))
        assert (first.names("all"), second.names("all"), trainer.begun) == (["all0", "all1"], ["all0"], 1)
        crew.split(CoreSplit(6, 2))
        assert (len(first.names("all")), len(second.names("all")), trainer.begun) == (3, 3, 2)
        assert "threads = 2" in (plan.out / "trainer.toml").read_text()


def test_collecting_is_paused_and_resumed_at_once_and_said_again_now_and_then(
    plan: LearnPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(time=time.time)
    monkeypatch.setattr(crew_module, "time", clock)
    asked = {1000.0: True, 1001.0: False, 1002.0: False, 1001.0 + PACE_S: False, 1007.0: True}
    said = []
    clock.monotonic = lambda: 0.0
    with Crew(plan, CoreSplit(2, 1)) as crew:
        for at_s, wanted in asked.items():
            clock.monotonic = partial(float, at_s)
            StandInBus.commands.clear()
            crew.pace(wanted)
            said.append(list(StandInBus.commands))
    pause, resume = [Command.PAUSE] * 2, [Command.RESUME] * 2
    assert said == [resume, pause, [], pause, resume]


def test_coordinator_that_answers_nobody_is_started_anew(plan: LearnPlan, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 1000.0
    monkeypatch.setattr(crew_module, "time", SimpleNamespace(time=time.time, monotonic=lambda: now_s))
    with Crew(plan, CoreSplit(2, 1)) as crew:
        monkeypatch.setattr(StandInBus, "deaf", True)
        for count in range(1, 2 * DEAF_MAX):
            now_s += PACE_S
            crew.pace(True)
            assert StandInFleet.made[0].killed == ["coordinator"] * (count >= DEAF_MAX)
        monkeypatch.setattr(StandInBus, "deaf", False)
        now_s += PACE_S
        crew.pace(True)
        monkeypatch.setattr(StandInBus, "deaf", True)
        now_s += PACE_S
        crew.pace(True)
        assert StandInFleet.made[0].killed == ["coordinator"], "one that answers in between is not deaf"
