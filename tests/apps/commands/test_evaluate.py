"""Which camera `readygo evaluate` looks through."""

import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.__main__ import main
from readygo.apps.commands import evaluate as evaluate_command
from readygo.apps.terminal import PlainConsole
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.errors import RunError
from readygo.common.policy import PolicySpec
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig
from readygo.services.evaluator import Task
from tests.common.dataset.episodes import write_shard
from tests.services.evaluator.test_scores import RECORDS


class StandIn:
    """A policy that stays where it is."""

    def __init__(self, spec: PolicySpec) -> None:
        self.spec = spec

    def start(self, robot: RobotConfig) -> SimpleNamespace:
        return SimpleNamespace(advance=lambda command: None)

    def see(self, memories, images) -> None:
        self.seen = images

    def decide(self, memories, previous, goals) -> np.ndarray:
        return np.zeros((len(memories), 2), np.float32)


@pytest.fixture
def evaluate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    """Runs the command with a policy of a fisheye camera; returns exit code, what it printed, and the policy."""
    camera = CameraConfig(height_px=24, width_px=32, distortion="fisheye", k1=0.01)
    policy = StandIn(PolicySpec(robot=RobotConfig(camera=camera), sensor=SensorConfig(k1=(0.0, 0.02))))
    monkeypatch.setattr("readygo.apps.commands.evaluate.load_policy", lambda folder: policy)
    monkeypatch.setattr("readygo.apps.commands.evaluate.policy_sha256", lambda folder: "ab")
    (tmp_path / "run.toml").write_text("[episode]\ntime_limit_s = 0.2\n")
    basics = ["embedded", "policy", "--episodes", "1", "--tasks", "static", "--methods", "policy", "--json"]

    def run(*arguments: str):
        config = () if "--config" in arguments else ("--config", str(tmp_path / "run.toml"))
        monkeypatch.setattr(sys, "argv", ["readygo", "evaluate", *basics, *config, *arguments])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        return code, capsys.readouterr(), policy

    return run


def test_camera_of_the_policy_looks_by_default(evaluate) -> None:
    code, printed, policy = evaluate()
    assert code == 0
    summary = json.loads(printed.out)
    assert summary["robot"]["camera"]["distortion"] == "fisheye"
    assert summary["sensor"]["k1"] == [0.0, 0.02]
    assert policy.seen.shape == (1, 24, 32, 3)


def test_another_camera_is_refused_by_name_or_taken_if_asked_for(evaluate, tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text("[camera]\nheight_px = 24\nwidth_px = 32\nhorizontal_fov_deg = 90\n")
    code, printed, _ = evaluate("--robot", str(robot))
    assert code == 2
    assert "horizontal_fov_deg 100 (the robot's: 90), distortion fisheye (the robot's: none), k1 0.01" in printed.err
    assert printed.err.count("\n") == 1
    code, printed, _ = evaluate("--robot", str(robot), "--camera", "robot")
    assert code == 0
    summary = json.loads(printed.out)
    assert summary["robot"]["camera"]["horizontal_fov_deg"] == 90.0
    assert summary["sensor"]["k1"] == []


def test_recipe_of_another_camera_is_refused(evaluate) -> None:
    code, printed, _ = evaluate("--sensor", "sensor_phone_like")
    assert code == 2
    assert "distortion fisheye (the robot's: brown_conrady)" in printed.err
    assert "sensor.exposure_ev none (the robot's: [-0.3, 0.3])" in printed.err


@pytest.mark.parametrize(
    ("text", "height_m"), [("[episode]\ntime_limit_s = 40.0\n", 0.9), ("[robot]\nheight_m = 0.8\n", 0.8)]
)
def test_policys_robot_drives_unless_the_configuration_names_another(
    text: str, height_m: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class StoppedError(Exception):
        pass

    def world(scene: str, config: RunConfig, **_: object) -> None:
        assert config.robot.height_m == height_m
        raise StoppedError

    class Trained:
        spec = PolicySpec(robot=RobotConfig(height_m=0.9))

    config = tmp_path / "run.toml"
    config.write_text(text)
    monkeypatch.setattr(evaluate_command, "load_policy", lambda _: Trained())
    monkeypatch.setattr(evaluate_command, "evaluation_world", world)
    with pytest.raises(StoppedError):
        evaluate_command.evaluate(evaluate_command.EvaluateOptions(scene="embedded", policy=tmp_path, config=config))


def test_ctrl_c_says_how_much_is_kept(evaluate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "out"
    assert evaluate("--out", str(out))[0] == 0
    assert {"episodes.jsonl", "trajectories.jsonl", "summary.json", "report.html", "failures.html"} <= {
        path.name for path in out.iterdir()
    }
    monkeypatch.setattr(evaluate_command, "handle_evaluate", interrupt)
    code, printed, _ = evaluate("--out", str(out), "--episodes", "3")
    assert code == 130
    assert f"readygo: stopped; 1 of 3 episodes are kept in {out}; the same command resumes." in printed.err
    code, printed, _ = evaluate()
    assert code == 130
    assert "nothing is kept: with --out" in printed.err


def test_method_that_fails_is_named_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.py").write_text(
        "class Lost:\n    def __init__(self, robot): ...\n    def start(self): ...\n"
        "    def act(self, memory, observation): raise RuntimeError('no map')\n"
    )
    (tmp_path / "run.toml").write_text("[episode]\ntime_limit_s = 0.2\n[robot.camera]\nheight_px = 24\nwidth_px = 32\n")
    method, config = f"{tmp_path / 'mine.py'}:Lost", str(tmp_path / "run.toml")
    basics = ["evaluate", "embedded", "--episodes", "1", "--tasks", "static", "--config", config]
    monkeypatch.setattr(sys, "argv", ["readygo", *basics, "--methods", method, "straight-line"])
    main()
    said = capsys.readouterr().out.replace("\n", "")
    assert "Lost failed in 1 episodes, in test-0-0000" in said
    assert "RuntimeError: no map" in said
    assert "Split test, seed 0; pedestrians: 1 to 2 at 0.8 to 1.4 m/s." in said


def test_films_need_a_folder_and_episodes_that_can_be_understood(evaluate) -> None:
    code, printed, _ = evaluate("--video", "worst")
    assert (code, printed.err.count("\n")) == (2, 1)
    assert "--out" in printed.err
    code, printed, _ = evaluate("--video", "best", "--out", "x")
    assert code == 2
    assert "'best'" in printed.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--episodes", "0"], "--episodes must be 1..10000000, got 0."),
        (["--workers", "-1", "--out", "new"], "--workers must be 0..256, got -1."),
        (["--out", "data"], "--out data holds recorded data; choose a new folder."),
        (["--out", "file"], "--out file is a file; choose a new folder."),
        (["--out", "trained"], "--out trained holds a policy (policy.toml); choose a new folder."),
    ],
)
def test_counts_and_folders_that_cannot_be_are_refused_by_option(
    options: list[str], words: str, evaluate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_shard(tmp_path / "data", [0])
    (tmp_path / "file").touch()
    (tmp_path / "trained").mkdir()
    (tmp_path / "trained" / "policy.toml").touch()
    before = sorted(tmp_path.rglob("*"))
    code, printed, _ = evaluate(*options)
    assert (code, printed.err) == (2, f"readygo: {words}\n")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((None, 1, "", ()), "--workers keep their records"),
        ((None, 0, "tcp/lab:1", ()), "--workers keep their records"),
        ((Path("out"), 0, "tcp/lab:1", ()), "--listen is for workers"),
        ((None, 0, "", ("worst",)), "--video writes films"),
        ((Path("out"), 1, "tcp/lab:1", ("worst",)), ""),
        ((None, 0, "", ()), ""),
    ],
)
def test_what_needs_a_folder_is_refused_without_one(options, words: str) -> None:
    if words:
        with pytest.raises(RunError, match=words):
            evaluate_command._check_folder(*options)
    else:
        evaluate_command._check_folder(*options)


def test_avatars_are_those_that_are_named_else_the_policys_or_those_that_it_has_not_seen(monkeypatch) -> None:
    policy = SimpleNamespace(spec="spec")
    monkeypatch.setattr(evaluate_command, "unseen_avatars", lambda spec: Path(f"unseen of {spec}"))
    monkeypatch.setattr(evaluate_command, "avatars_of_policy", lambda spec: Path(f"those of {spec}"))
    bodies = evaluate_command._bodies
    assert bodies(Path("mine"), policy, ("avatars",)) == Path("mine")
    assert bodies(None, None, ()) is None
    assert bodies(None, policy, ("scenes",)) == Path("those of spec")
    assert bodies(None, policy, ("scenes", "avatars")) == Path("unseen of spec")


def test_methods_without_a_policy_and_those_that_fail_are_told() -> None:
    assert evaluate_command._without_policy(evaluate_command.EvaluateOptions().methods) == ("expert", "straight-line")
    assert evaluate_command._without_policy(("expert", "mine")) == ("expert", "mine")
    assert evaluate_command._without_policy(()) == ()
    for named in (("policy",), ("policy", "expert", "mine")):
        with pytest.raises(RunError, match="The method `policy` needs a policy"):
            evaluate_command._without_policy(named)
    failed = [SimpleNamespace(method=m, reason=r, episode=SimpleNamespace(episode_id=f"e{k}"))
              for k, (m, r) in enumerate([("a", ""), ("a", "no <map>"), ("b", "lost"), ("a", "later")])]  # fmt: skip
    assert evaluate_command._failed_drivers(failed) == [
        "a failed in 2 episodes, in e1: no <map>",
        "b failed in 1 episodes, in e2: lost",
    ]


def test_success_rate_of_each_method_is_shown_as_it_drives() -> None:
    console = PlainConsole(file=io.StringIO(), width=200)
    with evaluate_command.episode_progress(console, 8, quiet=False) as (show, say):
        say("More workers <can> join.")
        for record in RECORDS[4:7]:
            show(record)
    lines = console.file.getvalue().splitlines()
    assert lines[0] == "More workers <can> join."
    assert lines[-1].startswith("episodes 3/8 dynamic policy: SR 67 %, ETA")


def test_what_is_kept_of_those_that_were_asked_for_is_counted(tmp_path: Path) -> None:
    request = SimpleNamespace(tasks=(Task.STATIC, Task.DYNAMIC), methods=("policy", "expert"))
    there = [
        (Task.STATIC, "policy", 0),
        (Task.REACTIVE, "policy", 0),
        (Task.STATIC, "other", 1),
        (Task.DYNAMIC, "expert", 2),
    ]
    results = SimpleNamespace(records=there, folder=tmp_path)
    for total, words in ((9, "2 of 9"), (1, "1 of 1")):
        with (
            pytest.raises(KeyboardInterrupt, match=f"^{words} episodes are kept in {tmp_path}; the same command"),
            evaluate_command._report_saved(results, request, total),
        ):
            raise KeyboardInterrupt
