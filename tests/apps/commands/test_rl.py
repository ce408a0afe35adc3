import json
import sys
from pathlib import Path

import pytest

from readygo.__main__ import main
from readygo.apps.commands.rl import RlOptions, rl
from readygo.common.errors import ConfigError, PolicyError, RunError, SceneError
from readygo.common.state_policy.state_policy import load_state_policy
from readygo.runs.scene_argument import open_scene

torch = pytest.importorskip("torch", reason="torch (extra train) is not installed")

SMALL = [
    "--train-episodes", "8", "--val-episodes", "4", "--val-every", "256", "--ppo.robots", "16", "--ppo.stretch", "8",
    "--ppo.minibatches", "2", "--demonstrations", "0",
]  # fmt: skip


def _run(command: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["readygo", *command])
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def test_policy_is_trained_and_the_next_command_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "policies" / "rl"
    command = ["rl", "embedded", "--out", str(out), "--decisions", "512", "--noise", "exact", *SMALL]
    assert _run(command, monkeypatch) == 0
    said = capsys.readouterr().out
    assert "512 decisions" in said
    assert f"readygo evaluate embedded --methods rl expert --checkpoints {out.parent}" in said
    assert {path.name for path in out.iterdir()} == {
        "actor.npz", "checkpoint.pt", "curve.jsonl", "curve.svg", "metrics.json", "state_policy.toml",
    }  # fmt: skip
    assert "missed = 0.0" in (out / "state_policy.toml").read_text()
    longer = ["rl", "embedded", "--out", str(out), "--decisions", "768", "--noise", "exact", "--json", *SMALL]
    assert _run(longer, monkeypatch) == 0
    assert json.loads(capsys.readouterr().out)["decisions"] == 768
    robot = tmp_path / "robot.toml"
    robot.write_text("radius_m = 0.2\n")
    for changed in (["--seed", "1"], ["--standing-max", "0"], ["--robot", str(robot)]):
        assert _run([*longer, *changed], monkeypatch) == 2
        assert "other settings, seed, scene, robot or people" in capsys.readouterr().err


@pytest.mark.parametrize("begun", [True, False])
def test_ctrl_c_before_the_first_checkpoint_says_that_drawn_episodes_stay(
    begun: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object, __: object, out: Path, **___: object) -> None:
        if begun:
            out.mkdir()
            (out / "checkpoint.pt").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr("readygo.apps.commands.rl.run_reinforcement", interrupt)
    assert _run(["rl", "embedded", "--out", str(tmp_path / "rl")], monkeypatch) == 130
    drawn, recorded = "drawn episodes stay in the user's cache", "what is recorded or saved stays"
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == f"readygo: stopped; {recorded if begun else drawn}, run the same command again to resume."


def test_one_policy_learns_in_several_scenes_and_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["rl", "embedded", "embedded:plan-1", "--decisions", "256", *SMALL, "--demonstrations", "10"]
    assert _run([*command, "--out", str(tmp_path / "rl")], monkeypatch) == 0
    said = capsys.readouterr().out
    assert "4 episodes of split val in embedded, embedded-plan-1" in said
    spec = load_state_policy(tmp_path / "rl").spec
    assert list(spec.scenes.values()) == ["embedded", "embedded-plan-1"]
    assert list(spec.scenes) == [open_scene(name).content_hash for name in command[1:3]]
    longer = [*command[:3], "--decisions", "512", *command[5:], "--out", str(tmp_path / "rl")]
    assert _run(longer, monkeypatch) == 0
    assert "512 decisions" in capsys.readouterr().out
    assert _run([*longer[:1], *longer[2:]], monkeypatch) == 2
    assert "other settings, seed, scene, robot or people" in capsys.readouterr().err


def test_expert_teaches_first_where_it_is_asked_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["rl", "embedded", "--out", str(tmp_path), "--decisions", "256", *SMALL, "--demonstrations", "5"]
    assert _run(command, monkeypatch) == 0
    assert "demonstrations = 5" in (tmp_path / "state_policy.toml").read_text()


def test_bad_input_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="not both"):
        rl(RlOptions(scenes=("embedded",), out=tmp_path, minutes=1.0, decisions=5))
    for minutes in (-1.0, 1e300):
        with pytest.raises(RunError, match="--minutes must be above 0 and at most 100000, got"):
            rl(RlOptions(scenes=("embedded",), out=tmp_path, minutes=minutes))
    with pytest.raises(RunError, match="--decisions must be at least 1, got 0"):
        rl(RlOptions(scenes=("embedded",), out=tmp_path, decisions=0))
    with pytest.raises(RunError, match="--workers must be at least 0, got -1"):
        rl(RlOptions(scenes=("embedded",), out=tmp_path, workers=-1))
    with pytest.raises(ConfigError, match="gamma"):
        rl(RlOptions(scenes=("embedded",), out=tmp_path, keys={"ppo": {"gamma": 3.0}}))
    with pytest.raises(SceneError):
        rl(RlOptions(scenes=(str(tmp_path / "nowhere"),), out=tmp_path))
    with pytest.raises(RunError, match="Name a scene"):
        rl(RlOptions(scenes=(), out=tmp_path))
    with pytest.raises(RunError, match="embedded is named twice; name each scene once"):
        rl(RlOptions(scenes=("embedded:1", "embedded", "embedded"), out=tmp_path))
    with pytest.raises(ConfigError, match=r"--ppo\.robots 1 are too few for 2 scenes"):
        rl(RlOptions(scenes=("embedded", "embedded:1"), out=tmp_path, keys={"ppo": {"robots": 1, "minibatches": 1}}))
    with pytest.raises(PolicyError, match="held"):
        rl(RlOptions(scenes=("embedded",), out=tmp_path, decisions=1, keys={"hold_s": 0.13}))
