import pytest

from readygo.common import errors
from readygo.common.errors import BusError, PeerError, ReadygoError, SceneError, cause, first_line, reason


def test_reason_of_a_users_mistake_is_its_message_and_of_a_bug_names_the_exception() -> None:
    assert reason(SceneError("No scene here; import one.")) == "No scene here; import one."
    assert reason(KeyError("x")) == "KeyError: 'x'"


def test_everything_that_a_user_can_mend_is_one_family() -> None:
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type)]
    assert all(issubclass(kind, ReadygoError) for kind in kinds)
    with pytest.raises(BusError):
        raise PeerError("plan: no scene is loaded.")


def test_first_line_of_what_a_library_says_or_its_name() -> None:
    assert first_line(RuntimeError("\n bad graph\nat node 3")) == "bad graph"
    for silent in (RuntimeError(), RuntimeError(" \n")):
        assert first_line(silent) == "RuntimeError"


def test_cause_leaves_out_number_and_file_of_the_operating_system() -> None:
    assert cause(FileNotFoundError(2, "No such file or directory", "a.toml")) == "No such file or directory"
    assert cause(ValueError("byte 3 is not UTF-8")) == "byte 3 is not UTF-8"
    assert cause(OSError("gone")) == "gone"
