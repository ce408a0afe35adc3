import logging

import pytest

from readygo.common.printable import PlainLines, strip_controls


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Zoë\t1\nto 2", "Zoë\t1\nto 2"),
        ("\x1b]0;title\x07", "]0;title"),
        ("\x1b[2Jgone", "[2Jgone"),
        ("\x9b2J\x7f", "2J"),
        ("over\rwritten\b", "overwritten"),
        ("a\u202eb\u2066", "ab"),
    ],
)
def test_characters_that_steer_a_terminal_are_left_out(text: str, shown: str) -> None:
    assert strip_controls(text) == shown


def test_log_of_what_a_peer_said_steers_no_terminal() -> None:
    record = logging.LogRecord("readygo", logging.WARNING, "", 1, "%s: %s", ("worker \x1b[2J", "lost"), None)
    assert PlainLines("%(levelname)s %(message)s").format(record) == "WARNING worker [2J: lost"
