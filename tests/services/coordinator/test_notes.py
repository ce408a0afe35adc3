from pathlib import Path

import pytest

from readygo.services.coordinator.database import Database
from readygo.services.coordinator.notes import Notes


@pytest.fixture
def notes(tmp_path: Path) -> Notes:
    return Notes(Database(tmp_path / "ledger.sqlite"))


def test_the_first_value_that_is_proposed_is_agreed_on(notes: Notes) -> None:
    assert [notes.agree("class", value) for value in ("a", "b")] == ["a", "a"]


def test_note_is_there_until_it_is_dropped(notes: Notes) -> None:
    assert (notes.get("paused"), "paused" in notes) == ("", False)
    notes.put("paused", "yes")
    notes.put("paused")
    assert (notes.get("paused"), "paused" in notes) == ("", True)
    notes.drop("paused")
    assert "paused" not in notes


def test_keys_are_found_by_how_they_begin(notes: Notes) -> None:
    for key in ("retired/a", "retired/b", "other"):
        notes.put(key)
    assert notes.keys("retired/") == {"a", "b"}


def test_turns_rise_whatever_the_clock_says(notes: Notes) -> None:
    assert [notes.next_turn(least) for least in (70, 50, 90)] == [70, 71, 90]


def test_counters_add_up_and_survive(tmp_path: Path) -> None:
    for amount in (1.5, 2.0):
        database = Database(tmp_path / "ledger.sqlite")
        Notes(database).add("cpu_s", amount)
        database.close()
    assert Notes(Database(tmp_path / "ledger.sqlite")).counters() == {"cpu_s": 3.5}


def test_notes_and_counters_are_of_their_own_key(notes: Notes) -> None:
    for key in ("a", "b"):
        notes.put(key, f"of {key}")
    notes.drop("a")
    assert (notes.get("a"), notes.get("b")) == ("", "of b")
    assert notes.next_turn(-5) == 1
    for counter, amount in (("cpu", 1.5), ("gpu", -2.0), ("cpu", 0.25)):
        notes.add(counter, amount)
    assert notes.counters() == {"cpu": 1.75, "gpu": -2.0}
    assert notes.keys("tu") == {"rn"}
