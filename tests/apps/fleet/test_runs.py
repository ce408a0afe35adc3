import dataclasses
from collections.abc import Callable

import pytest

from readygo.apps.fleet.runs import BARRED_S, FRESH_S, STEADY_S, Runs, none_such
from readygo.common.messages import StatusReply, topics
from readygo.common.messages.topics import Stream


class Router:
    """Tells of runs, at any time."""

    def __init__(self, **options: object) -> None:
        self.now_s = 100.0
        self.runs = Runs(self, clock=lambda: self.now_s, **options)  # type: ignore[arg-type]

    def subscribe(self, stream: Stream[StatusReply], hear: Callable[[StatusReply], None]) -> None:
        assert stream is topics.PROGRESS
        self._hear = hear

    def tell(self, run: str, *, priority: int = 0, leased: int = 0, **changed: object) -> None:
        told = {"waiting": {"human-plan": 5}, "finished": False, **changed}
        status = StatusReply(
            run=run,
            priority=priority,
            wanted=9,
            committed=0,
            samples=0,
            leased={"render": leased},
            rejected={},
            requeued=0,
            cpu_s={},
            **told,  # type: ignore[arg-type]
        )
        self._hear(status)

    def wait(self, seconds: float, **runs: dict[str, object]) -> None:
        """Let time pass while coordinators tell of their runs once a second."""
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.now_s += 1.0
            for run, told in runs.items():
                self.tell(run, **told)  # type: ignore[arg-type]


def test_most_urgent_run_with_work_is_done_first_and_of_equal_ones_that_with_fewest_workers() -> None:
    router = Router()
    assert router.runs.choose() == ""
    router.tell("low", priority=-1)
    assert router.runs.choose() == "low"
    router.tell("busy", priority=3, leased=4)
    router.tell("free", priority=3, leased=1)
    assert router.runs.choose() == "free"
    for nothing in ({"paused": True}, {"waiting": {"human-plan": 0}}, {"finished": True}, {"failed": "cancelled"}):
        router.tell("free", priority=3, leased=1, **nothing)
        assert router.runs.choose() == "busy"
    assert [status.run for status in router.runs.statuses()] == ["busy", "free", "low"]


def test_workers_spread_over_runs_that_are_equal() -> None:
    chosen = set()
    for number in range(20):
        router = Router(me=f"worker{number}")
        router.tell("a")
        router.tell("b")
        chosen.add(router.runs.choose())
    assert chosen == {"a", "b"}


def test_worker_leaves_for_a_more_urgent_run_once_that_has_had_work_for_a_while() -> None:
    router = Router()
    router.tell("own")
    router.tell("urgent", priority=1)
    assert not router.runs.better_than("own")
    router.wait(STEADY_S, own={}, urgent={"priority": 1})
    assert router.runs.better_than("own")
    assert not router.runs.better_than("urgent")
    router.wait(1.0, own={}, urgent={"priority": 1, "waiting": {}})
    assert not router.runs.better_than("own")


def test_worker_leaves_a_run_that_has_nothing_to_do_or_whose_coordinator_is_silent() -> None:
    router = Router()
    for own in ({"waiting": {}}, {"paused": True}):
        router.wait(STEADY_S + 1.0, own={"priority": 5}, other={})
        assert not router.runs.better_than("own")
        router.wait(STEADY_S + 1.0, own={"priority": 5, **own}, other={})
        assert router.runs.better_than("own")
    router.wait(1.0, own={"priority": 5}, other={})
    router.wait(FRESH_S, other={})
    assert router.runs.better_than("own")
    router.wait(FRESH_S)
    assert (router.runs.choose(), router.runs.statuses()) == ("", [])


def test_worker_of_a_role_looks_at_its_own_stages() -> None:
    router = Router(role="renderer")
    router.tell("planned")
    assert router.runs.choose() == ""
    router.tell("planned", waiting={"render": 1})
    assert router.runs.choose() == "planned"


def test_named_runs_alone_count_and_are_over_when_each_of_them_is() -> None:
    router = Router(named=("a", "b"))
    router.tell("c", priority=9)
    assert router.runs.choose() == ""
    router.tell("a")
    assert (router.runs.choose(), router.runs.open()) == ("a", ["a"])
    router.tell("a", finished=True)
    assert not router.runs.over
    router.tell("b")
    router.runs.left("b", over=True)
    assert router.runs.over
    # Somebody asks for more of it.
    router.tell("a")
    assert not router.runs.over


def test_run_that_does_not_work_is_left_alone_for_a_while_and_bad_names_for_good() -> None:
    router = Router()
    router.tell("a")
    router.runs.bar("a")
    for name in ("", "../up", "*", ".hidden"):
        router.tell(name)
    assert router.runs.choose() == ""
    router.now_s += BARRED_S
    for name in ("", "../up", "*", ".hidden", "a"):
        router.tell(name)
    assert router.runs.choose() == "a"


def test_unknown_run_is_told_with_those_that_there_are() -> None:
    router = Router()
    assert none_such("x", "tcp/lab:1", []) == "No coordinator leads run x at tcp/lab:1 (there is no run)."
    router.tell("a")
    assert none_such("x", "tcp/lab:1", router.runs.statuses()) == "No coordinator leads run x at tcp/lab:1 (there: a)."


def test_coordinator_that_is_silent_for_5_seconds_gives_out_no_work() -> None:
    router = Router()
    router.tell("a")
    router.now_s += 4.9
    assert (router.runs.choose(), router.runs.open()) == ("a", ["a"])
    router.now_s += 0.1
    assert (router.runs.choose(), router.runs.open(), router.runs.statuses()) == ("", [], [])


@pytest.mark.parametrize(("waited_s", "leaves"), [(1.9, False), (2.0, True)])
def test_more_urgent_run_must_have_had_work_for_2_seconds(waited_s: float, leaves: bool) -> None:
    router = Router()
    router.tell("own", priority=2)
    router.tell("urgent", priority=3, waiting={})
    router.now_s += 3.0
    for run, priority in (("own", 2), ("urgent", 3)):
        router.tell(run, priority=priority)
    router.now_s += waited_s
    for run, priority in (("own", 2), ("urgent", 3)):
        router.tell(run, priority=priority)
    assert router.runs.better_than("own") == leaves
    assert not router.runs.better_than("urgent")
    router.tell("urgent", priority=2)
    assert not router.runs.better_than("own"), "it is as urgent"


@pytest.mark.parametrize(("waited_s", "leaves"), [(1.9, False), (2.0, True)])
def test_run_without_work_is_left_after_2_seconds_for_one_that_is_less_urgent(waited_s: float, leaves: bool) -> None:
    router = Router()
    router.tell("own", priority=9)
    router.tell("other")
    router.now_s += 4.0
    router.tell("own", priority=9, waiting={"render": 0})
    router.now_s += waited_s
    router.tell("own", priority=9, waiting={"render": 0})
    router.tell("other")
    assert router.runs.better_than("own") == leaves
    assert not router.runs.better_than("unknown")


@pytest.mark.parametrize(("silent_s", "leaves"), [(4.9, False), (5.0, True)])
def test_run_whose_coordinator_is_silent_for_5_seconds_is_left_for_one_that_is_heard(
    silent_s: float, leaves: bool
) -> None:
    router = Router()
    router.tell("own", priority=9)
    router.tell("other")
    router.now_s += silent_s
    assert not router.runs.better_than("own") or not leaves
    router.tell("other")
    assert router.runs.better_than("own") == leaves


def test_workers_of_a_run_are_those_of_all_its_stages() -> None:
    router = Router()
    for run, leased in (("spread", {"render": 2, "animate": 3}), ("few", {"render": 4})):
        router.tell(run, leased=0)
        router._hear(dataclasses.replace(router.runs._heard[run].status, leased=leased))
    assert router.runs.choose() == "few"


@pytest.mark.parametrize(("role", "chosen"), [("all", "planned"), ("recorder", "planned"), ("renderer", "")])
def test_recorders_and_workers_of_everything_take_part_wherever_there_is_work(role: str, chosen: str) -> None:
    router = Router(role=role)
    router.tell("planned")
    assert router.runs.choose() == chosen


def test_what_is_heard_of_other_runs_says_nothing_of_those_that_are_named() -> None:
    router = Router(named=("mine",))
    router.now_s += 7.0
    router.tell("other")
    assert router.runs.heard_s == 100.0
    router.tell("mine", failed="cancelled")
    assert (router.runs.heard_s, router.runs.over, router.runs.open()) == (107.0, True, [])
    router.runs.bar("mine")
    router.now_s += BARRED_S - 0.1
    router.tell("mine")
    assert (router.runs.heard_s, router.runs.choose()) == (107.0, "")
    router.runs.left("mine", over=False)
    router.now_s += 0.1
    router.tell("mine")
    assert router.runs.choose() == "mine"
    router.runs.left("mine", over=False)
    assert router.runs.choose() == ""
