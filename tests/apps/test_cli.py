import errno
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import docstring_parser
import pytest

from readygo.apps.cli import Command, parse, run_command
from readygo.apps.commands import evaluate as evaluate_command
from readygo.apps.commands.train import closed_loop
from readygo.apps.demo.demo import _clear
from readygo.apps.run.config import RunConfig
from readygo.commands import COMMANDS
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError, RunError, SceneError
from readygo.common.policy.artifact import PolicySpec
from readygo.common.robot import RobotConfig

ROOT = Path(__file__).resolve().parents[2]
READYGO = [sys.executable, "-m", "readygo"]
ERRORS = {
    "missing": FileNotFoundError(errno.ENOENT, "No such file or directory", "lobby.ply"),
    "full": OSError(errno.ENOSPC, "No space left on device"),
    "bug": OSError(errno.EBADF, "Bad file descriptor"),
    "mistake": RunError("Ask for more."),
    "ctrl-c": KeyboardInterrupt(),
}


def fail(how: str, /) -> None:
    """Fail in one of the ways above."""
    raise ERRORS[how]


FAIL = {"fail": Command(f"{__name__}:fail", "fails")}


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    run_command(COMMANDS, ["--version"])
    assert re.fullmatch(r"readygo \d+\.\d+\.\d+\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("argv", "names"),
    [
        ([], list(COMMANDS)),
        (["--help"], list(COMMANDS)),
        (["scene", "--help"], ["scene import", "scene inspect"]),
        (["bench"], ["bench render", "bench motion", "bench plan"]),
    ],
)
def test_help_lists_the_commands_of_a_group(
    argv: list[str], names: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    run_command(COMMANDS, argv)
    assert re.findall(r"^  (\w+(?: \w+)?)  ", capsys.readouterr().out, re.MULTILINE) == names


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["fly"], "unknown command 'fly'; see `readygo --help`."),
        (["scene", "paint", "x"], "unknown command 'scene paint'; see `readygo scene --help`."),
        (["import"], "unknown command 'import'; see `readygo --help`."),
    ],
)
def test_unknown_command_is_one_line(argv: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(COMMANDS, argv)
    assert stopped.value.code == 2
    assert capsys.readouterr().err == f"readygo: {message}\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_values_after_what_they_are(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        parse(COMMANDS, [*name.split(), "--help"])
    assert stopped.value.code == 0
    shown = capsys.readouterr().out
    assert f"usage: readygo {name}" in shown
    assert re.findall(r"\bSTR\b|\{None\}", shown) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_help_explains_every_argument(name: str) -> None:
    module, function_name = COMMANDS[name].path.split(":")
    function = getattr(importlib.import_module(module), function_name)
    documented = {entry.arg_name for entry in docstring_parser.parse(inspect.getdoc(function) or "").params}
    assert set(inspect.signature(function).parameters) == documented


def test_value_names_say_scene_and_data(capsys: pytest.CaptureFixture[str]) -> None:
    shown = ""
    for command in ("generate", "evaluate", "train"):
        with pytest.raises(SystemExit):
            parse(COMMANDS, [command, "--help"])
        shown += capsys.readouterr().out
    for text in ("] SCENE\n", "] SCENE [POLICY]\n", "] DATA [DATA ...]\n", "--out PATH ", "--val-scene SCENE "):
        assert text in shown
    assert "--split {train,val,test}" in shown
    assert "--people {paper,varied,crowd}" in shown


@pytest.mark.parametrize(
    ("how", "code", "message"),
    [
        ("missing", 2, "No such file or directory: lobby.ply."),
        ("full", 2, "No space left on device."),
        ("mistake", 2, "Ask for more."),
        ("ctrl-c", 130, "stopped; what is recorded or saved stays, run the same command again to go on."),
    ],
)
def test_what_a_user_can_mend_is_one_line(
    how: str, code: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        run_command(FAIL, ["fail", how])
    assert stopped.value.code == code
    assert capsys.readouterr().err == f"readygo: {message}\n"


def test_error_of_the_system_that_names_no_file_is_a_bug() -> None:
    with pytest.raises(OSError, match="Bad file descriptor"):
        run_command(FAIL, ["fail", "bug"])


def test_ctrl_c_while_modules_load_is_one_line() -> None:
    code = """
        import os, signal, sys
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


def test_demo_refuses_a_folder_that_no_demo_has_made(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "shard-rec0-00000.mcap").write_text("precious")
    with pytest.raises(RunError, match="holds files of something else"):
        _clear(tmp_path)
    assert (tmp_path / "data" / "shard-rec0-00000.mcap").read_text() == "precious"


def test_demo_replaces_an_earlier_demo(tmp_path: Path) -> None:
    _clear(tmp_path / "demo")
    (tmp_path / "demo" / "data").mkdir()
    _clear(tmp_path / "demo")
    assert not (tmp_path / "demo" / "data").exists()


def test_closed_loop_validation_that_cannot_work_is_refused_before_training(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="one or more episodes"):
        closed_loop("embedded", episodes=0, seed=0)
    with pytest.raises(SceneError, match="does not exist"):
        closed_loop(str(tmp_path / "nowhere"), episodes=1, seed=0)


def test_setting_that_must_be_an_array_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"expert\.lookahead_m must be an array, got 0\.5"):
        section_from_mapping(RunConfig, {"expert": {"lookahead_m": 0.5}})
    with pytest.raises(ConfigError, match=r"^robot: radius_m must be positive"):
        section_from_mapping(RunConfig, {"robot": {"radius_m": -1.0}})


@pytest.mark.parametrize(
    ("text", "height_m"), [("[episode]\ntime_limit_s = 40.0\n", 0.9), ("[robot]\nheight_m = 0.8\n", 0.8)]
)
def test_policys_robot_drives_unless_the_configuration_names_another(
    text: str, height_m: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class StoppedError(Exception):
        pass

    def evaluator(scene: str, config: RunConfig, **_: object) -> None:
        assert config.robot.height_m == height_m
        raise StoppedError

    class Trained:
        spec = PolicySpec(robot=RobotConfig(height_m=0.9))

    config = tmp_path / "run.toml"
    config.write_text(text)
    monkeypatch.setattr(evaluate_command, "load_policy", lambda _: Trained())
    monkeypatch.setattr(evaluate_command, "make_evaluator", evaluator)
    with pytest.raises(StoppedError):
        evaluate_command.evaluate("embedded", tmp_path, config=config)
