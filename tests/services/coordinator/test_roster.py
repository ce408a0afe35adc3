from readygo.services.coordinator.roster import Roster


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_worker_that_is_silent_and_what_it_holds() -> None:
    clock = Clock()
    roster = Roster(clock)
    roster.note_presence("renderer", "r0", alive=True)
    roster.note_heard("r0")
    roster.note_lease(4, 2)
    clock.now_s += 7.0
    (worker,) = roster.workers([("r0", "render", 4, 2)])
    assert (worker.role, worker.silent_s, worker.holds[0].held_s) == ("renderer", 7.0, 7.0)


def test_holder_that_is_gone_has_no_role() -> None:
    roster = Roster(Clock())
    roster.note_presence("renderer", "r0", alive=True)
    roster.note_presence("renderer", "r0", alive=False)
    (worker,) = roster.workers([("r0", "render", 4, 2)])
    assert worker.role == ""


def test_rates_are_those_of_the_last_minute() -> None:
    clock = Clock()
    roster = Roster(clock)
    for _ in range(3):
        roster.note_done("r0", "render", 1, failed=False)
    clock.now_s += 30.0
    roster.note_done("r0", "render", 2, failed=True)
    assert roster.done_per_minute() == {"render": 6.0}
    clock.now_s += 31.0
    assert roster.done_per_minute() == {}


def test_names_of_nobody_are_not_kept() -> None:
    roster = Roster(Clock())
    for number in range(5):
        roster.note_heard(f"forged{number}")
    assert roster.workers([]) == ()
    assert roster._heard_s == {}
