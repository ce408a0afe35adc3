from readygo.services.coordinator.roster import Roster
from tests.clock import Clock


def test_worker_that_is_silent_and_what_it_holds() -> None:
    clock = Clock(100.0)
    roster = Roster(clock)
    roster.note_presence("renderer", "r0", alive=True)
    roster.note_heard("renderer", "r0")
    roster.note_lease("renderer", "r0", 4, 2)
    clock.now_s += 7.0
    (worker,) = roster.workers([("renderer", "r0", "render", 4, 2)])
    assert (worker.role, worker.silent_s, worker.holds[0].held_s) == ("renderer", 7.0, 7.0)


def test_holder_that_is_gone_has_no_role() -> None:
    roster = Roster(Clock(100.0))
    roster.note_presence("renderer", "r0", alive=True)
    roster.note_presence("renderer", "r0", alive=False)
    (worker,) = roster.workers([("renderer", "r0", "render", 4, 2)])
    assert worker.role == ""


def test_rates_are_those_of_the_last_minute() -> None:
    clock = Clock(100.0)
    roster = Roster(clock)
    for _ in range(3):
        roster.note_done("render", 1, 1, failed=False)
    clock.now_s += 30.0
    roster.note_done("render", 2, 1, failed=True)
    assert roster.done_per_minute() == {"render": 6.0}
    clock.now_s += 31.0
    assert roster.done_per_minute() == {}


def test_names_of_nobody_are_not_kept() -> None:
    roster = Roster(Clock(100.0))
    for number in range(5):
        roster.note_heard("renderer", f"forged{number}")
    assert roster.workers([]) == ()
    assert roster._heard_s == {}


def test_workers_of_one_name_in_two_roles_are_two() -> None:
    clock = Clock(100.0)
    roster = Roster(clock)
    for index, role in enumerate(("animator", "renderer")):
        roster.note_presence(role, "desk-1", "s", alive=True)
        roster.note_lease(role, "desk-1", index, 1)
    clock.now_s += 5.0
    roster.note_renewed(1, 1)
    roster.note_done("animate", 0, 1, failed=False)
    roster.note_done("animate", 0, 1, failed=False)
    roster.note_done("render", 1, 2, failed=False)
    animator, renderer = roster.workers([("renderer", "desk-1", "render", 1, 1)])
    assert (animator.role, animator.done, animator.silent_s, animator.holds) == ("animator", 1, 0.0, ())
    assert (renderer.role, renderer.done, renderer.silent_s, len(renderer.holds)) == ("renderer", 0, 0.0, 1)
    assert not roster.note_presence("animator", "desk-1", "s", alive=False)
    assert [worker.role for worker in roster.workers([])] == ["renderer"]


def test_worker_is_there_while_any_of_its_lives_is() -> None:
    roster = Roster(Clock(100.0))
    assert roster.note_presence("recorder", "rec0", "first", alive=True)
    assert roster.note_presence("recorder", "rec0", "second", alive=True)
    assert roster.note_presence("recorder", "rec0", "first", alive=False)
    assert not roster.note_presence("recorder", "rec0", "second", alive=False)
    assert not roster.note_presence("recorder", "rec0", "second", alive=False)
    assert roster.size == 0
