import errno
import functools
import inspect
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import tyro
from tyro.conf import Positional

from readygo.apps.cli import CliCommand, function_of, options_of, parse, read_options, run_command
from readygo.apps.options import SHORT_MAX, describe_options, option_name, section_groups
from readygo.commands import COMMANDS
from readygo.common.errors import ConfigError, RunError
from readygo.runs.sections import Keys

ROOT = Path(__file__).resolve().parents[2]
READYGO = [sys.executable, "-m", "readygo"]
ERRORS = {
    "missing": FileNotFoundError(errno.ENOENT, "No such file or directory", "lobby.ply"),
    "full": OSError(errno.ENOSPC, "No space left on device"),
    "bug": OSError(errno.EBADF, "Bad file descriptor"),
    "mistake": RunError("Ask for more."),
    "hostile": RunError("coord/spec: \x1b]0;title\x07\x1b[2Jno."),
    "ctrl-c": KeyboardInterrupt(),
    "ctrl-c-with-words": KeyboardInterrupt("3 of 4 are kept."),
}


@dataclass(frozen=True, kw_only=True)
class FailOptions:
    """Fail in one of the ways above."""

    how: Positional[str]
    """The way."""


def fail(options: FailOptions) -> None:
    """Fail."""
    raise ERRORS[options.how]


FAIL = {"fail": CliCommand(f"{__name__}:fail", "fails")}


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    run_command(COMMANDS, ["--version"])
    assert re.fullmatch(r"readygo \d+\.\d+\.\d+\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("argv", "names"),
    [
        ([], list(COMMANDS)),
        (["--help"], list(COMMANDS)),
        (["scene", "--help"], [name for name in COMMANDS if name.startswith("scene ")]),
        (["bench"], [name for name in COMMANDS if name.startswith("bench ")]),
    ],
)
def test_help_lists_the_commands_of_a_group(
    argv: list[str], names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    run_command(COMMANDS, argv)
    assert re.findall(r"^  ([\w-]+(?: \w+)?)  ", capsys.readouterr().out, re.MULTILINE) == names


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["fly"], "unknown command 'fly'; see `readygo --help`."),
        (["scene", "paint", "x"], "unknown command 'scene paint'; see `readygo scene --help`."),
        (["record"], "unknown command 'record'; see `readygo --help`."),
        (["genrate", "embedded"], "unknown command 'genrate' (did you mean generate?); see `readygo --help`."),
        (["scen", "import"], "unknown command 'scen' (did you mean scene?); see `readygo --help`."),
        (
            ["scene", "imprt", "x.ply"],
            "unknown command 'scene imprt' (did you mean scene import?); see `readygo scene --help`.",
        ),
    ],
)
def test_unknown_command_is_one_line(argv: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(COMMANDS, argv)
    assert stopped.value.code == 2
    assert capsys.readouterr().err == f"readygo: {message}\n"


@pytest.mark.parametrize("command", ["generate", "train", "learn", "marker", "scene import"])
@pytest.mark.parametrize("empty", [["--out", ""], ["--out="]])
def test_empty_path_is_not_the_current_folder(
    command: str, empty: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(COMMANDS, [*command.split(), "x", *empty])
    assert stopped.value.code == 2
    assert capsys.readouterr().err == f"readygo: --out must name a path, got ''; see `readygo {command} --help`.\n"


@dataclass(frozen=True, kw_only=True)
class StopOptions:
    """Make a folder and be interrupted."""

    out: Path
    """The folder."""
    saved: str = ""
    """A file in it."""
    words: tuple[str, ...] = ()
    """What the command says of it."""


def stop(options: StopOptions) -> None:
    """Make a folder and be interrupted."""
    options.out.mkdir(exist_ok=True)
    if options.saved:
        (options.out / options.saved).touch()
    raise KeyboardInterrupt(*options.words)


def test_ctrl_c_tells_whether_something_is_saved_and_leaves_no_empty_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = {"stop": CliCommand(f"{__name__}:stop", "stops")}
    out, kept = tmp_path / "out", "readygo: stopped; what is recorded or saved stays, "
    for options, words in (
        ([], "readygo: stopped; nothing is saved yet.\n"),
        (["--words", "The state is elsewhere."], "readygo: stopped; The state is elsewhere.\n"),
        (["--saved", "checkpoint"], kept),
    ):
        with pytest.raises(SystemExit) as stopped:
            run_command(commands, ["stop", "--out", str(out), *options])
        assert stopped.value.code == 130
        assert capsys.readouterr().err.startswith(words)
        assert out.exists() == ("--saved" in options)
    (tmp_path / "empty").mkdir()
    with pytest.raises(SystemExit):
        run_command(commands, ["stop", "--out", str(tmp_path / "empty")])
    assert (tmp_path / "empty").exists(), "a folder that was there stays"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_values_after_what_they_are(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    parse(COMMANDS, [*name.split(), "--help-all"])()
    shown = capsys.readouterr().out
    assert f"usage: readygo {name}" in shown
    assert re.findall(r"\bSTR\b|\{None\}", shown) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_short_help_has_at_most_12_options_and_names_where_the_others_are(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parse(COMMANDS, [*name.split(), "--help"])()
    shown = capsys.readouterr().out
    assert len(re.findall(r"^  (?! )", shown, re.MULTILINE)) <= SHORT_MAX
    parse(COMMANDS, [*name.split(), "--help-all"])()
    everything = capsys.readouterr().out
    assert shown.startswith(everything) == (shown == everything)
    assert (f"All options: readygo {name} --help-all" in shown) == (shown != everything)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_explains_every_option_and_key(name: str) -> None:
    about = describe_options(options_of(function_of(COMMANDS[name])))
    groups = section_groups(about.sections, about.options) if about.sections else ()
    keys = [key for group in groups for key in group.options]
    assert [option.flag for option in (*about.options, *keys) if not option.words] == []


def test_value_names_say_scene_and_data(capsys: pytest.CaptureFixture[str]) -> None:
    shown = ""
    for command in ("generate", "evaluate", "train"):
        parse(COMMANDS, [command, "--help-all"])()
        shown += capsys.readouterr().out
    for text in (" [SCENE] --", " [SCENE] [POLICY] [OPT", " DATA [DATA ...] --", "--out PATH ", "--val-scene SCENE "):
        assert text in shown
    assert "--split {train,val,test}" in shown
    assert "--people {paper,varied,crowd}" in shown


def test_help_names_defaults_only_where_there_is_something_to_name(capsys: pytest.CaptureFixture[str]) -> None:
    parse(COMMANDS, ["learn", "--help"])()
    shown = capsys.readouterr().out
    for text in ("default: None", "default: ''", "default: )"):
        assert text not in shown
    assert "(default: 60.0)" in shown
    assert "(required)" in shown


@pytest.mark.parametrize(
    ("how", "code", "message"),
    [
        ("missing", 2, "No such file or directory: lobby.ply."),
        ("full", 2, "No space left on device."),
        ("mistake", 2, "Ask for more."),
        ("hostile", 2, "coord/spec: ]0;title[2Jno."),
        ("ctrl-c-with-words", 130, "stopped; 3 of 4 are kept."),
        ("ctrl-c", 130, "stopped; what is recorded or saved stays, run the same command again to resume."),
    ],
)
def test_what_a_user_can_mend_is_one_line(
    how: str, code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(FAIL, ["fail", how])
    assert stopped.value.code == code
    assert capsys.readouterr().err == f"readygo: {message}\n"


@dataclass(frozen=True, kw_only=True)
class NoOptions:
    """Wait."""


def be_terminated(options: NoOptions) -> None:
    """Get a SIGTERM, and end what was begun."""
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(20.0)
    finally:
        # One that is impatient does not disturb the end.
        os.kill(os.getpid(), signal.SIGTERM)
        sys.stderr.write("ended in peace\n")


def test_sigterm_ends_a_command_as_ctrl_c_does(capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGTERM)
    try:
        with pytest.raises(SystemExit) as stopped:
            run_command({"wait": CliCommand(f"{__name__}:be_terminated", "waits")}, ["wait"])
    finally:
        signal.signal(signal.SIGTERM, before)
    assert stopped.value.code == 143
    assert capsys.readouterr().err.startswith("ended in peace\nreadygo: stopped; ")


STOPPED_IN_A_DESTRUCTOR = """
import dataclasses, os, signal, sys, time
from readygo.apps import cli

class Last:
    def __del__(self):
        os.kill(os.getpid(), signal.{name})
        time.sleep(5.0)

@dataclasses.dataclass
class NoOptions:
    pass

def wait(options: NoOptions):
    last = Last()
    del last
    time.sleep(60.0)

sys.modules["waits"] = sys.modules["__main__"]
# Whoever runs the tests in the background has it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.unraisablehook = cli.stop_later
cli.run_command({{"wait": cli.CliCommand("waits:wait", "waits")}}, ["wait"])
"""


@pytest.mark.parametrize(("name", "code"), [("SIGTERM", 143), ("SIGINT", 130)])
def test_a_command_that_is_stopped_in_a_destructor_ends_all_the_same(name: str, code: int) -> None:
    text = STOPPED_IN_A_DESTRUCTOR.format(name=name)
    ended = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=30, check=False)
    assert (ended.returncode, ended.stderr.split(";")[0]) == (code, "readygo: stopped")


def test_error_of_the_system_that_names_no_file_is_a_bug() -> None:
    with pytest.raises(OSError, match="Bad file descriptor"):
        run_command(FAIL, ["fail", "bug"])


def test_ctrl_c_while_modules_load_is_one_line() -> None:
    code = """
        import os, signal, sys
        signal.signal(signal.SIGINT, signal.default_int_handler)
        class Interrupt:
            def find_spec(self, name, path=None, target=None):
                if name == "tyro":
                    os.kill(os.getpid(), signal.SIGINT)
        sys.meta_path.insert(0, Interrupt())
        sys.argv = ["readygo", "avatar", "list"]
        from readygo.__main__ import main
        main()
    """
    command = [sys.executable, "-c", inspect.cleandoc(code)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "readygo: stopped before anything was done.\n"


@pytest.mark.parametrize(
    ("redirection", "code", "error"),
    [
        ("| true", 141, ""),
        (">&-", 0, ""),
        ("2>&-", 0, ""),
        ("<&- >&- 2>&-", 0, ""),
        ("> /dev/full", 2, "readygo: No space left on device.\n"),
    ],
)
def test_output_that_nobody_takes_is_no_traceback(redirection: str, code: int, error: str) -> None:
    line = f"set -o pipefail; {sys.executable} -m readygo avatar list --json {redirection}"
    done = subprocess.run(["bash", "-c", line], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, error)


def test_terminal_without_unicode_gets_question_marks() -> None:
    environment = {"PYTHONIOENCODING": "ascii", "PATH": "", "HOME": str(ROOT)}
    command = [*READYGO, "generate", "--help"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("argv", "keys"),
    [
        ("--driver.disturbed 0.2 --static", {"driver": {"disturbed": 0.2}}),
        ("--renderer.outputs=rgb,depth", {"renderer": {"outputs": ["rgb", "depth"]}}),
        ("--robot.camera.k1 -0.2", {"robot": {"camera": {"k1": -0.2}}}),
        ("", {}),
    ],
)
def test_keys_of_the_configuration_are_options(argv: str, keys: Keys) -> None:
    call = parse(COMMANDS, ["generate", "embedded", "--out", "data", *argv.split()])
    assert isinstance(call, functools.partial)
    assert call.args[0].keys == keys
    assert call.args[0].recording.static is ("--static" in argv)


@pytest.mark.parametrize(
    ("argv", "section"),
    [
        ("plan embedded --recorder.fsync false", "recorder"),
        ("plan embedded --coordinator.lease-s 3", "coordinator"),
        ("simulate-robot embedded --recorder.fsync=false", "recorder"),
        ("simulate-robot embedded --coordinator.lease-s 3", "coordinator"),
        ("evaluate embedded --recorder.fsync false", "recorder"),
    ],
)
def test_keys_without_effect_are_refused_in_a_line(argv: str, section: str) -> None:
    with pytest.raises(ConfigError, match=f"^keys of --{section} have no effect in this command; see"):
        parse(COMMANDS, argv.split())


@pytest.mark.parametrize("endpoint", ["foo", "tcp/127.0.0.1:99999"])
@pytest.mark.parametrize(
    "command",
    [
        "generate embedded --out {out} --listen",
        "generate embedded --out {out} --on hosts --connect",
        "coordinator {out} --listen",
        "coordinator {out} --connect",
        "router --listen",
        "worker all --connect",
        "worker recorder --run r --data {out} --connect",
        "status --connect",
        "status --run r --connect",
        "pause --run r --connect",
        "monitor --run r --connect",
        "learn embedded --out {out} --listen",
        "evaluate embedded --methods expert --workers 1 --out {out} --listen",
        "reconstruct film.mp4 --out {out} --listen",
        "simulate-robot embedded --listen",
        "drive policy --goal 1 1 --connect",
    ],
)
def test_endpoint_that_is_none_is_one_line_and_nothing_is_made(
    command: str, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("READYGO_TOKEN", "secret")
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        run_command(COMMANDS, [*command.format(out=out).split(), endpoint])
    said = capsys.readouterr().err
    assert (stopped.value.code, said.count("\n")) == (2, 1)
    assert said.endswith(f"must be of the form tcp/HOST:PORT or tls/HOST:PORT, PORT 1..65535, got {endpoint!r}.\n")
    assert not out.exists()


@dataclass(frozen=True, kw_only=True)
class ChooseOptions:
    """Choose."""

    place: Positional[str]
    """Where."""
    from_: Annotated[str, tyro.conf.arg(name="from")] = ""
    """Whence."""
    to_there: str = ""
    """Whither."""


def choose(options: ChooseOptions) -> tuple[str, str, str]:
    """Choose."""
    return options.place, options.from_, options.to_there


def test_option_may_be_called_by_a_word_of_the_language(capsys: pytest.CaptureFixture[str]) -> None:
    assert (option_name("from_"), option_name("to_there")) == ("--from", "--to-there")
    commands = {"choose": CliCommand(f"{__name__}:choose", "chooses")}
    assert parse(commands, ["choose", "here", "--from", "a", "--to-there", "b"])() == ("here", "a", "b")
    parse(commands, ["choose", "--help"])()
    assert "--from FROM" in capsys.readouterr().out


def test_value_of_several_options_is_one_value() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Options:
        slurm: str = ""
        out: str = ""
        watch: bool = False

    def read(*words: str) -> tuple[str, str, bool]:
        read = read_options(Options, words, prog="x")
        return read.slurm, read.out, read.watch

    assert read("--slurm", "--time=1:00 -n 2", "--watch") == ("--time=1:00 -n 2", "", True)
    assert read("--slurm", "-p x y", "--out", "a b") == ("-p x y", "a b", False)
    assert read("--watch", "--out=a b") == ("", "a b", True)
