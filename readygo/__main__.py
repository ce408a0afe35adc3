"""The command line: `readygo`, or `python -m readygo`."""

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130


def main() -> None:
    """Run the command that the arguments name."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop_at_once)
    from readygo.apps.cli import run_command, stop_later
    from readygo.commands import COMMANDS
    from readygo.common.left_open import close_all

    sys.unraisablehook = stop_later
    try:
        run_command(COMMANDS, sys.argv[1:])
    finally:
        close_all()


def _stop_at_once(signal_number: int, frame: FrameType | None) -> None:
    # While modules load, they may turn an exception into a different one, and there is nothing to undo.
    os.write(2, b"readygo: stopped before anything was done.\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
