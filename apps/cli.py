"""The command line: finds a command, reads its arguments with tyro, reports user errors in one line."""

import contextlib
import dataclasses
import difflib
import functools
import importlib
import io
import itertools
import logging
import os
import signal
import sys
import threading
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn, TypeVar

if TYPE_CHECKING:
    from readygo.apps.options import Option

# One numba and BLAS thread per process: the fleet is parallel by processes. Set before NumPy is imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

USER_MISTAKE = 2
INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
READER_GONE = 128 + signal.SIGPIPE
HELP = ("-h", "--help")
HELP_ALL = "--help-all"
KEPT = "what is recorded or saved stays, run the same command again to resume."
NOTHING_SAVED = "nothing is saved yet."
AGAIN_S = 0.05
ALIKE_MIN = 0.8
"""Similarity from which a misspelt command is taken for another; "record" is none of "recover"."""


Options = TypeVar("Options")


class CliCommand(NamedTuple):
    """One command of the command line."""

    path: str
    """Its function, as "package.module:function", whose only argument is the dataclass of its options."""
    summary: str
    """One line for the list of commands."""


def run_command(commands: Mapping[str, CliCommand], argv: Sequence[str]) -> None:
    """Run the command that the arguments name.

    Errors that the user can mend print one line and exit with 2: a `ReadygoError`, an error of the operating system
    that names a file, a full disk. Every other exception is a bug and shows its traceback. Ctrl-C exits with 130;
    SIGTERM ends a command in the same way, with 143.
    """
    from readygo.common.errors import NO_ROOM, ReadygoError
    from readygo.common.printable import PlainLines

    _mend_streams()
    if logging.lastResort:
        logging.lastResort.setFormatter(PlainLines())
    try:
        try:
            call = parse(commands, argv)
        finally:
            if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
                signal.signal(signal.SIGINT, signal.default_int_handler)
        if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
            signal.signal(signal.SIGTERM, _terminate)
        _run(call)
        sys.stdout.flush()
    except ReadygoError as error:
        _stop(str(error), USER_MISTAKE)
    except BrokenPipeError:
        _drop_output()
        raise SystemExit(READER_GONE) from None
    except OSError as error:
        # The error of a full disk names no file, yet the user can mend it.
        if error.filename is None and error.errno not in NO_ROOM:
            raise
        _drop_output()
        _stop(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}.", USER_MISTAKE)
    except KeyboardInterrupt as stop:
        # A command that knows what it leaves behind raises the interrupt again with that information.
        said = str(stop) or KEPT
        _stop(f"stopped; {said}", TERMINATED if _was_terminated() else INTERRUPTED)


def _run(call: Callable[[], object]) -> None:
    """Run a command; where it is interrupted before it saved anything, say so and remove the empty folder it made."""
    options = call.args[0] if isinstance(call, functools.partial) and call.args else None
    out = Path(getattr(options, "out", None) or "")
    was_there = out.exists()
    try:
        call()
    except KeyboardInterrupt as stop:
        if was_there:
            raise
        with contextlib.suppress(OSError):
            out.rmdir()
        if str(stop):
            raise
        raise KeyboardInterrupt(KEPT if out.exists() else NOTHING_SAVED) from None


def _terminate(number: int, frame: object) -> None:
    """End as at Ctrl-C, so that the command ends its child processes and threads too; ignore further SIGTERMs."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


def stop_later(lost: "sys.UnraisableHookArgs") -> None:
    """A `sys.unraisablehook` that repeats an interrupt that came where nothing can be raised, as in a destructor."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    number = signal.SIGTERM if _was_terminated() else signal.SIGINT
    if number == signal.SIGTERM:
        signal.signal(number, _terminate)
    threading.Timer(AGAIN_S, os.kill, (os.getpid(), number)).start()


def _was_terminated() -> bool:
    return signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


def parse(commands: Mapping[str, CliCommand], argv: Sequence[str]) -> Callable[[], object]:
    """The command that the arguments name, ready to be called.

    Raises:
        ReadygoError: If there is no such command, or the arguments do not fit it.
    """
    from readygo.common.errors import ReadygoError

    for count in (2, 1):
        name = " ".join(argv[:count])
        if name in commands:
            return _call(function_of(commands[name]), f"readygo {name}", argv[count:])
    if list(argv) == ["--version"]:
        return functools.partial(_print, f"readygo {_version()}")
    words = [word for word in argv if word not in HELP]
    group = {name: command for name, command in commands.items() if name.startswith(f"{' '.join(words)} ")}
    if words and not group:
        of_group = {name for name in commands if name.startswith(f"{words[0]} ")}
        known = {name.split()[-1]: name for name in of_group} or {name.split()[0]: name.split()[0] for name in commands}
        named = words[: 2 if of_group else 1]
        close = difflib.get_close_matches(named[-1], known, n=1, cutoff=ALIKE_MIN)
        meant = f" (did you mean {known[close[0]]}?)" if close else ""
        see = " ".join(["readygo", *named[:-1], "--help"])
        raise ReadygoError(f"unknown command {' '.join(named)!r}{meant}; see `{see}`.")
    return functools.partial(_print, _overview(group or commands))


def _call(function: Callable[..., object], prog: str, argv: Sequence[str]) -> Callable[[], object]:
    kind = options_of(function)
    asked = [word for word in argv if word in (*HELP, HELP_ALL)]
    if asked:
        from readygo.apps.options import help_text

        return functools.partial(_print, help_text(prog, kind, everything=HELP_ALL in asked))
    return functools.partial(function, read_options(kind, argv, prog=prog))


def _overview(commands: Mapping[str, CliCommand]) -> str:
    width = max(len(name) for name in commands)
    lines = ["usage: readygo COMMAND ..., or readygo COMMAND --help, or readygo --version", ""]
    return "\n".join([*lines, *(f"  {name:<{width}}  {command.summary}" for name, command in commands.items())])


def _version() -> str:
    import readygo

    return readygo.__version__


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")


def function_of(command: CliCommand) -> Callable[..., object]:
    """The function of a command; its module is imported."""
    module, name = command.path.split(":")
    function: Callable[..., object] = getattr(importlib.import_module(module), name)
    return function


def options_of(function: Callable[..., object]) -> type:
    """The dataclass of a command's options: the type of its only argument."""
    (kind,) = (hint for name, hint in typing.get_type_hints(function).items() if name != "return")
    return typing.cast(type, kind)


def read_options(kind: type[Options], argv: Sequence[str], *, prog: str) -> Options:
    """A command's options from its arguments.

    Args:
        kind: Dataclass of the options.
        argv: The arguments after the command's name.
        prog: The command, such as "readygo generate".

    Raises:
        ReadygoError: If the arguments do not fit.
    """
    import tyro

    from readygo.apps.options import describe_options, sections_field
    from readygo.apps.usage import errors_in_one_line
    from readygo.common.errors import ConfigError
    from readygo.runs.sections import NO_KEYS

    options, found, keys = describe_options(kind).options, sections_field(kind), NO_KEYS
    if found:
        try:
            argv, keys = found[1].take(argv, [option.flag for option in options])
        except ConfigError as error:
            raise ConfigError(f"{error}; see `{prog} --help-all`.") from None
    _check_paths(argv, options, prog)
    with errors_in_one_line(options, found[1] if found else None):
        read = tyro.cli(
            kind, prog=prog, args=_join_values(argv, options), config=(tyro.conf.OmitArgPrefixes,), add_help=False
        )
    return dataclasses.replace(read, **{found[0]: keys}) if found and keys else read  # type: ignore[type-var]


def _check_paths(argv: Sequence[str], options: "Sequence[Option]", prog: str) -> None:
    """Raise ReadygoError for an empty path, as of a shell's unset variable: it would name the current folder."""
    from readygo.common.errors import ReadygoError

    flags = {option.flag for option in options if option.value == "PATH"}
    for before, word in itertools.pairwise(["", *argv]):
        flag = before if not word else word.removesuffix("=") if word.endswith("=") else ""
        if flag in flags:
            raise ReadygoError(f"{flag} must name a path, got ''; see `{prog} --help`.")


def _join_values(argv: Sequence[str], options: "Sequence[Option]") -> list[str]:
    """Arguments in which --slurm "--time=1:00:00 -n 2" is one word: the value would be taken for an option."""
    flags, valued = {option.flag for option in options}, {option.flag for option in options if option.value}
    joined: list[str] = []
    for word in argv:
        is_text = word.startswith("-") and " " in word and word.partition("=")[0] not in flags
        if is_text and joined and joined[-1] in valued:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _mend_streams() -> None:
    """Redirect closed standard streams to /dev/null, and print "?" for characters that the encoding lacks."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # open() takes the lowest free descriptor, which is this one.
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _drop_output() -> None:
    """Discard unwritten output: otherwise the interpreter would retry at exit and report an error."""
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        return
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _stop(message: str, code: int) -> NoReturn:
    from readygo.common.printable import strip_controls

    sys.stderr.write(f"readygo: {strip_controls(message)}\n")
    raise SystemExit(code)
