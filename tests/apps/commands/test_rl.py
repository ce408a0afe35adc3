import json
import sys
from pathlib import Path

import pytest

from readygo.__main__ import main
from readygo.apps.commands.rl import RlOptions, rl
from readygo.common.errors import ConfigError, PolicyError, RunError, SceneError

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


def test_expert_teaches_first_where_it_is_asked_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ["rl", "embedded", "--out", str(tmp_path), "--decisions", "256", *SMALL, "--demonstrations", "5"]
    assert _run(command, monkeypatch) == 0
    assert "demonstrations = 5" in (tmp_path / "state_policy.toml").read_text()


def test_bad_input_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="not both"):
        rl(RlOptions(scene="embedded", out=tmp_path, minutes=1.0, decisions=5))
    with pytest.raises(RunError, match="--minutes must be positive"):
        rl(RlOptions(scene="embedded", out=tmp_path, minutes=-1.0))
    with pytest.raises(ConfigError, match="gamma"):
        rl(RlOptions(scene="embedded", out=tmp_path, keys={"ppo": {"gamma": 3.0}}))
    with pytest.raises(SceneError):
        rl(RlOptions(scene=str(tmp_path / "nowhere"), out=tmp_path))
    with pytest.raises(PolicyError, match="held"):
        rl(RlOptions(scene="embedded", out=tmp_path, decisions=1, keys={"hold_s": 0.13}))
