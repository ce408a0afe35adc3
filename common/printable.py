"""Text that others wrote, made safe for a terminal and a log."""

import logging
import re

# Control characters but for tab and line feed, and those that change the direction of what follows.
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def strip_controls(text: str) -> str:
    """The text without characters that steer a terminal; tabs and line feeds stay."""
    return _CONTROLS.sub("", text)


class PlainLines(logging.Formatter):
    """Lines of a log without characters that steer a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        """The line of a record."""
        return strip_controls(super().format(record))
