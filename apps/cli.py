"""The command line: finds a command, reads its arguments with tyro, reports user errors in one line."""

import contextlib
import dataclasses
import errno
import functools
import importlib
import inspect
import io
import logging
import os
import signal
import sys
import threading
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, NoReturn

# One numba and BLAS thread per process: the fleet is parallel by processes. Set before NumPy is imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

USER_MISTAKE = 2
INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
READER_GONE = 128 + signal.SIGPIPE
HELP = ("-h", "--help")
AGAIN_S = 0.05
NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a full disk: such errors name no file, yet the user can mend them."""


class Bare(NamedTuple):
    """Annotation of an option, as in `Annotated[float | None, Bare("0.5")]`: its value if only its name is given."""

    value: str


class Group(NamedTuple):
    """Annotation of an option: help shows it below a heading, "NAME options", with others of that group."""

    name: str


class Repeated(NamedTuple):
    """Annotation of an option whose type is a tuple: the option's name is repeated before each value."""


class Command(NamedTuple):
    """One command of the command line."""

    path: str
    """Its function, as "package.module:function"; the module is imported when the command is called."""
    summary: str
    """One line for the list of commands."""


def run_command(commands: Mapping[str, Command], argv: Sequence[str]) -> None:
    """Run the command that the arguments name.

    Errors that the user can mend print one line and exit with 2: a `ReadygoError`, an error of the operating system
    that names a file, a full disk. Every other exception is a bug and shows its traceback. Ctrl-C exits with 130;
    SIGTERM ends a command in the same way, with 143.
    """
    from readygo.common.errors import ReadygoError
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
        call()
        sys.stdout.flush()
    except ReadygoError as error:
        _stop(str(error), USER_MISTAKE)
    except BrokenPipeError:
        _drop_output()
        raise SystemExit(READER_GONE) from None
    except OSError as error:
        if error.filename is None and error.errno not in NO_ROOM:
            raise
        _drop_output()
        _stop(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}.", USER_MISTAKE)
    except KeyboardInterrupt as stop:
        # A command that knows what it leaves behind raises the interrupt again with that information.
        said = str(stop) or "what is recorded or saved stays, run the same command again to resume."
        _stop(f"stopped; {said}", TERMINATED if _terminated() else INTERRUPTED)


def _terminate(number: int, frame: object) -> None:
    """End as at Ctrl-C, so that the command ends its child processes and threads too; ignore further SIGTERMs."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


def stop_later(lost: "sys.UnraisableHookArgs") -> None:
    """A `sys.unraisablehook` that repeats an interrupt that came where nothing can be raised, as in a destructor."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    number = signal.SIGTERM if _terminated() else signal.SIGINT
    if number == signal.SIGTERM:
        signal.signal(number, _terminate)
    threading.Timer(AGAIN_S, os.kill, (os.getpid(), number)).start()


def _terminated() -> bool:
    return signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


def parse(commands: Mapping[str, Command], argv: Sequence[str]) -> Callable[[], object]:
    """The command that the arguments name, ready to be called.

    Raises:
        ReadygoError: If there is no such command, or the arguments do not fit it.
        SystemExit: If they ask for its help, which is printed.
    """
    from readygo.common.errors import ReadygoError

    for count in (2, 1):
        name = " ".join(argv[:count])
        if name in commands:
            return _bound(function_of(commands[name]), prog=f"readygo {name}", argv=argv[count:])
    if list(argv) == ["--version"]:
        return functools.partial(_print, f"readygo {_version()}")
    words = [word for word in argv if word not in HELP]
    group = {name: command for name, command in commands.items() if name.startswith(f"{' '.join(words)} ")}
    if words and not group:
        help_of = words[0] if any(name.startswith(f"{words[0]} ") for name in commands) else ""
        see = " ".join(["readygo", *help_of.split(), "--help"])
        raise ReadygoError(f"unknown command {' '.join(words[:2])!r}; see `{see}`.")
    return functools.partial(_print, _overview(group or commands))


def _overview(commands: Mapping[str, Command]) -> str:
    width = max(len(name) for name in commands)
    lines = ["usage: readygo COMMAND ..., or readygo COMMAND --help, or readygo --version", ""]
    return "\n".join([*lines, *(f"  {name:<{width}}  {command.summary}" for name, command in commands.items())])


def _version() -> str:
    import readygo

    return readygo.__version__


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")


def function_of(command: Command) -> Callable[..., object]:
    """The function of a command; its module is imported."""
    module, name = command.path.split(":")
    function: Callable[..., object] = getattr(importlib.import_module(module), name)
    return function


def _bound(function: Callable[..., object], *, prog: str, argv: Sequence[str]) -> Callable[[], object]:
    """Bind a command's function to its parsed arguments."""
    import tyro

    from readygo.apps.usage import errors_in_one_line

    hints = typing.get_type_hints(function, include_extras=True)
    parameters = [
        parameter.replace(annotation=_with_value_name(hints[name], parameter))
        for name, parameter in inspect.signature(function).parameters.items()
    ]
    groups = _groups(hints, parameters, function.__doc__ or "")
    grouped = {field.name for group in groups for field in dataclasses.fields(group.annotation)}

    def bind(*args: Any, **kwargs: Any) -> Callable[[], object]:
        members = [kwargs.pop(group.name) for group in groups]
        return functools.partial(function, *args, **kwargs, **{k: v for part in members for k, v in vars(part).items()})

    shown = [parameter for parameter in parameters if parameter.name not in grouped] + groups
    bind.__doc__ = function.__doc__
    bind.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
    bind.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
    config = [tyro.conf.OmitArgPrefixes] if groups else []
    named = [parameter for parameter in parameters if parameter.kind is not inspect.Parameter.POSITIONAL_ONLY]
    with errors_in_one_line([option_name(parameter.name) for parameter in named]):
        return tyro.cli(bind, prog=prog, args=_with_bare_values(hints, argv), config=config)


def _groups(hints: Mapping[str, Any], parameters: Sequence[inspect.Parameter], words: str) -> list[inspect.Parameter]:
    """One parameter per group of options, a dataclass with the options as fields: help shows each below a heading."""
    import docstring_parser
    import tyro

    members: dict[str, list[inspect.Parameter]] = {}
    for parameter in parameters:
        for said in getattr(hints[parameter.name], "__metadata__", ()):
            if isinstance(said, Group):
                members.setdefault(said.name, []).append(parameter)
    described = (
        {entry.arg_name: " ".join((entry.description or "").split()) for entry in docstring_parser.parse(words).params}
        if members
        else {}
    )
    made = []
    for name, options in members.items():
        fields = [
            (
                option.name,
                Annotated[option.annotation, tyro.conf.arg(help=described[option.name])],
                dataclasses.field(default=option.default),
            )
            for option in options
        ]
        kind = dataclasses.make_dataclass(name, fields, frozen=True, kw_only=True)
        keyword = inspect.Parameter.KEYWORD_ONLY
        made.append(inspect.Parameter(name, keyword, default=kind(), annotation=kind))
    return made


def option_name(parameter: str) -> str:
    """The option of a command's parameter; `from_` becomes --from, because `from` is a keyword of Python."""
    return f"--{parameter.rstrip('_').replace('_', '-')}"


def _with_bare_values(hints: Mapping[str, Any], argv: Sequence[str]) -> list[str]:
    """The arguments, with the `Bare` value added to each option that came without a value."""
    bare = {
        option_name(name): said.value
        for name, hint in hints.items()
        for said in getattr(hint, "__metadata__", ())
        if isinstance(said, Bare)
    }
    words = []
    for word, after in zip(argv, [*argv, "--"][1:], strict=True):
        words.append(f"{word}={bare[word]}" if word in bare and after.startswith("-") else word)
    return words


def _with_value_name(hint: Any, parameter: inspect.Parameter) -> Any:
    """The type hint, annotated with the value's name in the help: SCENE, PATH, {train,val,test}."""
    import tyro

    positional = parameter.kind is inspect.Parameter.POSITIONAL_ONLY
    repeated = Repeated() in getattr(hint, "__metadata__", ())
    of = typing.get_args(typing.get_args(hint)[0])[0] if repeated else hint
    name = value_name(of, parameter.name if positional else parameter.name.rstrip("_").rsplit("_", 1)[-1], positional)
    if repeated:
        append: Any = tyro.conf.UseAppendAction
        hint = append[hint]
    if name is None:
        return hint
    optional = positional and parameter.default is not inspect.Parameter.empty
    # "(default: None)" says nothing; the argument's description names the default.
    several = positional and typing.get_origin(hint) is tuple
    unsaid = parameter.default in (None, "", ()) or several
    metavar = f"[{name}]" if optional else name
    called = parameter.name.rstrip("_") if parameter.name.endswith("_") else None
    return Annotated[hint, tyro.conf.arg(name=called, metavar=metavar, help_behavior_hint="" if unsaid else None)]


def value_name(hint: Any, name: str, positional: bool) -> str | None:
    """Name of a value in the help, such as PATH; None keeps tyro's."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return value_name(arguments[0], name, positional)
    if origin in (types.UnionType, typing.Union):
        kinds = [kind for kind in arguments if kind is not type(None)]
        return value_name(kinds[0], name, positional) if len(kinds) == 1 else None
    if origin is Literal:
        return f"{{{','.join(map(str, arguments))}}}"
    if origin is tuple and arguments[1:] == (...,):
        item = value_name(arguments[0], name, positional)
        return item and f"{item} [{item} ...]"
    if origin is tuple:
        items = [value_name(argument, name, positional) for argument in arguments]
        return " ".join(item for item in items if item) if all(items) else None
    if hint is str or (positional and hint is Path):
        return name.upper()
    return {Path: "PATH", int: "INT", float: "FLOAT"}.get(hint)


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
