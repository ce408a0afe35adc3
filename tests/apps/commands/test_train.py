import dataclasses
import io
import json
import math
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.__main__ import main
from readygo.apps.commands import train as command
from readygo.apps.commands.train import (
    TrainDetailOptions,
    TrainFleetOptions,
    TrainOptions,
    _default_recipe,
    _progress,
    _report,
    train,
)
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError
from readygo.runs.scene_argument import open_scene
from tests.common.dataset.episodes import ROBOT, provenance_with_robot, write_shard


def test_losses_are_shown_once_they_are_known() -> None:
    console = PlainConsole(file=io.StringIO(), width=200, force_terminal=True, color_system=None)
    with _progress(console, quiet=False) as show:
        show(SimpleNamespace(fraction=0.1, step=0, train_loss=math.nan, validation_loss=math.nan))
        show(SimpleNamespace(fraction=0.5, step=7, train_loss=0.25, validation_loss=math.nan))
    shown = console.file.getvalue()
    assert "step 7, loss 0.2500, ETA" in shown
    assert "nan" not in shown


def test_recipe_that_nobody_named_is_said() -> None:
    console = PlainConsole(file=io.StringIO(), width=200)
    assert _default_recipe(SimpleNamespace(has_expert=True), console, quiet=False) == "best"
    assert _default_recipe(SimpleNamespace(has_expert=False), console, quiet=True) == "fast"
    assert console.file.getvalue() == "Recipe best: the expert was asked at every state in these data.\n"


def test_what_is_missing_is_said(tmp_path) -> None:
    with pytest.raises(ConfigError, match="No data folder"):
        train(TrainOptions(data=(), out=tmp_path))
    with pytest.raises(ConfigError, match="--run"):
        train(TrainOptions(data=(), out=tmp_path, fleet=TrainFleetOptions(live="tcp/127.0.0.1:1")))


def _run(command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> tuple[object, str]:
    """Exit code and last line of a command line."""
    monkeypatch.setattr(sys, "argv", ["readygo", *command])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code, capsys.readouterr().err.splitlines()[-1]


def _sizes(folder: Path) -> None:
    write_shard(folder, [9], number=1, height_px=16, width_px=20)


def _limits(folder: Path) -> None:
    write_shard(folder, [9], number=1, provenance=provenance_with_robot(v_max_mps=0.7))


def _cameras(folder: Path) -> None:
    camera = dataclasses.replace(ROBOT.camera, horizontal_fov_deg=80.0)
    write_shard(folder, [9], number=1, provenance=provenance_with_robot(camera=camera))


def _empty(folder: Path) -> None:
    (folder / "shard-r0-00001.mcap").write_bytes(b"")


def _half_written(folder: Path) -> None:
    whole = folder / "shard-r0-00000.mcap"
    (folder / "shard-r0-00001.mcap").write_bytes(whole.read_bytes()[:-2000])


def _unfinished(folder: Path) -> None:
    (folder / "shard-r0-00000.mcap").rename(folder / "shard-r0-00000.mcap.part")


def _nothing(folder: Path) -> None:
    shutil.rmtree(folder)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_sizes, "Image sizes differ: 24x32 in .*, 16x20 in "),
        (_limits, r"Robots differ: v_max_mps 1\.0 and 0\.7 in "),
        (_cameras, r"Robots differ: camera\.horizontal_fov_deg 100\.0 and 80\.0 in "),
        (_empty, r"shard-r0-00001\.mcap cannot be read"),
        (_half_written, r"shard-r0-00001\.mcap is truncated"),
        (_unfinished, "holds no finished shards .*; 1 are still being written"),
        (_nothing, "does not exist"),
    ],
)
def test_data_that_cannot_be_used_are_one_line_and_leave_nothing(
    spoil: Callable[[Path], None], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    write_shard(tmp_path / "data", [0, 1, 2])
    spoil(tmp_path / "data")
    out = tmp_path / "policy"
    code, line = _run(["train", str(tmp_path / "data"), "--out", str(out)], monkeypatch, capsys)
    assert code == 2
    assert re.search(rf"^readygo: .*({words})", line)
    assert not out.exists()


@pytest.mark.parametrize("command", ["train data", "train data --recipe gnm", "learn embedded", "rl embedded"])
def test_data_folder_and_file_are_no_folders_of_a_policy(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_shard(tmp_path / "data", [0, 1, 2])
    before = sorted(tmp_path.rglob("*"))
    code, line = _run([*command.split(), "--out", "data"], monkeypatch, capsys)
    assert (code, line) == (2, "readygo: --out data holds recorded data; choose a new folder.")
    assert sorted(tmp_path.rglob("*")) == before
    (tmp_path / "file").touch()
    code, line = _run([*command.split(), "--out", "file"], monkeypatch, capsys)
    assert (code, line) == (2, "readygo: --out file is a file; choose a new folder.")


@pytest.mark.parametrize(
    "command", ["train data", "train data --recipe perception", "train data --recipe gnm", "rl embedded"]
)
def test_policy_without_a_checkpoint_is_not_replaced(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "policy.toml").touch()
    code, line = _run([*command.split(), "--out", "old"], monkeypatch, capsys)
    assert (code, line) == (
        2,
        "readygo: --out old holds a policy (policy.toml) without checkpoint.pt: copy that too to resume, or choose a "
        "new folder.",
    )


@pytest.mark.parametrize("recipe", ["fast", "perception", "gnm"])
def test_budget_beyond_all_measure_is_refused_by_its_option(
    recipe: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_shard(tmp_path / "data", [0, 1, 2])
    options = ["--out", str(tmp_path / "policy"), "--recipe", recipe, "--minutes", "1e300"]
    code, line = _run(["train", str(tmp_path / "data"), *options], monkeypatch, capsys)
    assert (code, line) == (2, "readygo: --minutes must be above 0 and at most 100000, got 1e+300.")


def test_recipe_of_another_architecture_does_not_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    write_shard(tmp_path / "data", [0, 1, 2])
    options = ["train", str(tmp_path / "data"), "--out", str(tmp_path / "policy"), "--sampling.batch-size", "32"]
    monkeypatch.setattr(sys, "argv", ["readygo", *options, "--samples", "32", "--recipe", "fast", "--threads", "1"])
    main()
    before = (tmp_path / "policy" / "checkpoint.pt").read_bytes()
    code, line = _run([*options, "--samples", "64", "--recipe", "best", "--threads", "1"], monkeypatch, capsys)
    assert code == 2
    assert re.search(r"checkpoint\.pt belongs to a run with another \w+; give another --out\.$", line)
    assert (tmp_path / "policy" / "checkpoint.pt").read_bytes() == before


def test_training_is_told_in_which_episodes_its_weights_are_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[object, str]] = []
    monkeypatch.setattr(command, "closed_loop", lambda scene, **settings: settings)
    monkeypatch.setattr(
        command, "run_training", lambda *_, evaluate, evaluated, **more: told.append((evaluate, evaluated)) or {}
    )
    write_shard(tmp_path / "data", [0, 1, 2])
    given = TrainOptions(data=(tmp_path / "data",), out=tmp_path / "policy", json=True)
    scene = dataclasses.replace(given, val_scene="embedded")
    fewer = dataclasses.replace(scene, details=TrainDetailOptions(val_episodes=5))
    for options in (given, scene, scene, fewer, dataclasses.replace(scene, seed=1)):
        train(options)
    assert told[0] == (None, "")
    assert told[1] == told[2]
    assert (told[3][0]["episodes"], told[4][0]["seed"]) == (5, 1)
    assert len({evaluated for _, evaluated in told}) == 4
    assert open_scene("embedded").content_hash in told[1][1]


METRICS = {
    "parameters": 1234, "samples_seen": 5678, "elapsed_s": 12.6, "samples_per_s": 450.4, "chosen_step": 7, "steps": 9,
    "validation_samples": 40, "validation_episodes": 3, "rmse_v_mps": 0.1234, "ratio_v": 0.456, "rmse_w_radps": 0.2345,
    "ratio_w": 0.678, "history": [{"step": 1}],
}  # fmt: skip


def test_metrics_are_told_without_their_history(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _report(METRICS, tmp_path, as_json=True)
    short = {name: value for name, value in METRICS.items() if name != "history"}
    assert json.loads(capsys.readouterr().out) == {**short, "policy": str(tmp_path)}
    _report(METRICS, tmp_path, as_json=False)
    lines = [
        "1,234 parameters, 5,678 samples learned from in 13 s (450 samples/s); step 7 of 9 chosen.",
        "Held out (3 episodes): v 0.123 m/s = 46 %, w 0.234 rad/s = 68 % of predicting the mean.",
        f"Next: readygo evaluate SCENE {tmp_path}",
    ]
    assert capsys.readouterr().out.splitlines() == lines
    _report({**METRICS, "validation_samples": 0}, tmp_path, as_json=False)
    assert capsys.readouterr().out.splitlines() == [lines[0], lines[2]]


def test_training_beside_a_fleet_is_told_what_it_was_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked, closed = {}, []
    bus = SimpleNamespace(close=lambda: closed.append(1))
    monkeypatch.setattr(
        "readygo.apps.fleet.access.join", lambda *words, **more: (asked.update(join=(words, more)), bus)[1]
    )
    trainer = pytest.importorskip("readygo.apps.fleet.trainer")
    monkeypatch.setattr(trainer, "train_beside", lambda *words, **more: (asked.update(train=(words, more)), METRICS)[1])
    monkeypatch.setattr(command.signal, "signal", lambda number, act: asked.setdefault("signals", []).append(act))
    out, data = tmp_path / "out", (tmp_path / "a",)
    train(
        TrainOptions(
            data=data,
            out=out,
            samples=64,
            seed=5,
            json=True,
            fleet=TrainFleetOptions(live="tls/lab:1", run="run-7", certs=tmp_path),
        )
    )
    assert asked["join"] == (("tls/lab:1", "run-7", "trainer"), {"certs": tmp_path})
    (buses, config, where), more = asked["train"]
    assert (buses, where, more["data"]) == ({"run-7": bus}, out, data)
    assert (config.samples, config.seed) == (64, 5)
    assert closed == [1]
    assert len(asked["signals"]) == 2
    assert not more["stop"].is_set()
    asked["signals"][0]()
    assert more["stop"].is_set()
    assert json.loads(capsys.readouterr().out)["policy"] == str(out)
    with pytest.raises(ConfigError, match="--live takes no --cameras"):
        train(
            TrainOptions(
                data=data,
                out=out,
                fleet=TrainFleetOptions(live="tls/lab:1", run="run-7"),
                details=TrainDetailOptions(cameras="left"),
            )
        )


@pytest.mark.parametrize(
    "option",
    [
        {"fleet": TrainFleetOptions(live="x")},
        {"fleet": TrainFleetOptions(run="x")},
        {"val": (Path("x"),)},
        {"val_scene": "x"},
        {"inputs": "rgb"},
        {"goal": "point"},
    ],
)
def test_published_networks_take_no_options_of_ours(option: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--recipe gnm takes no --val, --val-scene"):
        train(TrainOptions(data=(tmp_path,), out=tmp_path, recipe="gnm", **option))  # type: ignore[arg-type]


def test_key_that_a_published_network_does_not_take_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match="takes no key weight-decay; it takes threads, cache-mb, batch-size, learning-rate, validation-fraction",
    ):
        train(TrainOptions(data=(), out=tmp_path, recipe="gnm", keys={"optimizer": {"weight_decay": 0.1}}))


HELD_OUT = {
    "images": 20, "people": 7, "average_precision": 0.824, "bearing_deg": 0.44, "distance": 0.051, "missed": 0.09,
    "along_r2": 0.61, "across_r2": 0.15, "rays": 0.06,
}  # fmt: skip


def test_perception_is_trained_with_its_settings_and_told_with_how_well_it_sees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []
    metrics = {"parameters": 9, "samples_seen": 8, "elapsed_s": 7.4, "images": 5, "held_out": HELD_OUT}
    monkeypatch.setattr(
        command, "train_perception", lambda *words, scenes, show: asked.append((*words, scenes)) or metrics
    )
    config = tmp_path / "perception.toml"
    config.write_text("batch_size = 16\nlearning_rate = 0.1\n")
    options = TrainOptions(
        data=(tmp_path / "data",),
        out=tmp_path / "runs" / "perception",
        recipe="perception",
        minutes=3.0,
        seed=4,
        config=config,
        details=command.TrainDetailOptions(scene=("embedded",)),
        keys={"optimizer": {"learning_rate": 0.01}, "threads": 2, "perception": "earlier"},
    )
    train(options)
    data, settings, out, scenes = asked[0]
    assert (data, out, scenes) == ((tmp_path / "data",), tmp_path / "runs" / "perception", ("embedded",))
    assert (settings.minutes, settings.seed, settings.threads) == (3.0, 4, 2)
    assert (settings.batch_size, settings.learning_rate, settings.perception) == (16, 0.01, "earlier")
    said = capsys.readouterr().out
    assert "9 parameters, 8 images learned from in 7 s (5 different ones)." in said
    assert "AP 0.82, bearing 0.4 deg, distance 5 %, 9 % missed, velocity R2 0.61 along and 0.15 across" in said
    assert f"--methods perceive-and-plan expert --checkpoints {tmp_path / 'runs'}" in said


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"val_scene": "embedded"}, "--recipe perception takes no --val, --val-scene"),
        ({"goal": "image"}, "--recipe perception takes no --val, --val-scene"),
        ({"keys": {"network": {"fusion": "early"}}}, "--recipe perception takes no key fusion; it takes threads"),
        ({"minutes": -1.0}, "^--minutes must be above 0 and at most 100000, got -1"),
    ],
)
def test_what_perception_does_not_take_is_named(option: dict[str, object], words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        train(TrainOptions(data=(tmp_path,), out=tmp_path, recipe="perception", **option))  # type: ignore[arg-type]


def test_perception_without_data_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No data folder is given"):
        train(TrainOptions(data=(), out=tmp_path, recipe="perception"))


def test_published_network_is_told_with_how_well_it_steers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_shard(tmp_path / "data", [0])
    asked = []
    metrics = {
        "parameters": 9, "samples_seen": 8, "elapsed_s": 7.4, "held_out_episodes": 3, "waypoint_error_m": 0.1236,
        "waypoint_error_of_mean_m": 0.4567,
    }  # fmt: skip
    monkeypatch.setattr(
        command, "make_network_config", lambda name, settings: asked.append((name, settings)) or "config"
    )
    monkeypatch.setattr(command, "run_network_training", lambda *words: asked.append(words[1:3]) or metrics)
    train(
        TrainOptions(
            data=(tmp_path / "data",),
            out=tmp_path / "out",
            recipe="vint",
            minutes=3.0,
            keys={"sampling": {"batch_size": 4}},
        )
    )
    assert asked[0] == ("vint", {"batch_size": 4, "minutes": 3.0, "samples": None, "seed": None})
    assert asked[1] == ("config", tmp_path / "out")
    assert capsys.readouterr().out.splitlines() == [
        "9 parameters, 8 samples learned from in 7 s.",
        "Held out (3 episodes): 0.124 m from where the expert went to where it steers; 0.457 m to the mean.",
        f"Next: readygo evaluate SCENE --methods vint --checkpoints {tmp_path / 'out'}",
    ]
