"""The assembly line as a user starts it: one process, fleets, interruptions; always the same samples."""

import dataclasses
import json
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Literal

import numpy as np
import pytest

from readygo.__main__ import main
from readygo.apps.commands import generate as command
from readygo.apps.commands.generate import (
    GenerateOptions,
    PlaceOptions,
    RecordingOptions,
    _check_place,
    _record,
    generate,
    progress_bar,
)
from readygo.apps.fleet.options import FleetOptions
from readygo.apps.observe.settings import Observing
from readygo.benchmarks.recording.memory import workers_below
from readygo.common.dataset import Dataset, validate
from readygo.common.dataset.provenance import TeacherOrigin
from readygo.common.errors import CertificateError, ConfigError, RunError
from readygo.common.messages import DriverKind, StatusReply
from readygo.runs.folder import RunFolder
from tests.common.messages.run_specs import SPEC
from tests.common.policy.artifacts import ROBOT, write_policy
from tests.common.state_policy.state_policies import write_state_policy
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[3]
EPISODES = 5
CONFIG = """
[episode]
goal_distance_max_m = 4.0
"""


@pytest.fixture(scope="module")
def scene(embedded_bundle: Path) -> Path:
    return embedded_bundle


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("config") / "short.toml"
    path.write_text(CONFIG)
    return path


@pytest.fixture(scope="module")
def in_one_process(scene: Path, config: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "zero"
    generate(GenerateOptions(scene=str(scene), out=out, episodes=EPISODES, workers=0, config=config, json=True))
    return out


def _digests(data: Path) -> dict[str, str]:
    return {entry.episode.episode_id: entry.sha256 for entry in Dataset([data]).episodes}


def _command(scene: Path, config: Path, out: Path, workers: int) -> list[str]:
    options = ["--out", str(out), "--episodes", str(EPISODES), "--workers", str(workers), "--config", str(config)]
    return [sys.executable, "-m", "readygo", "generate", str(scene), *options, "--json"]


def _rendering(out: Path) -> bool:
    log = out / ".readygo" / "logs" / "renderer0.log"
    part = list(out.glob("*.part"))
    return log.exists() and bool(part)


def test_recorded_dataset_holds_the_smallest_accepted_indices(in_one_process: Path) -> None:
    episodes = Dataset([in_one_process]).episodes
    assert len(episodes) == EPISODES
    assert all(entry.sample_count > 20 for entry in episodes)


def test_depth_and_masks_are_recorded_beside_the_same_images(
    in_one_process: Path, scene: Path, config: Path, tmp_path: Path
) -> None:
    out = tmp_path / "rich"
    generate(
        GenerateOptions(
            scene=str(scene), out=out, episodes=1, workers=0, config=config, outputs="rgb,depth,mask", json=True
        )
    )
    rich, plain = Dataset([out]), Dataset([in_one_process])
    assert rich.outputs == ("rgb", "depth", "mask")
    assert [rich.image(sample) for sample in range(len(rich))] == [plain.image(sample) for sample in range(len(rich))]
    seen = [sample for sample in range(len(rich)) if rich.decode_output(sample, "mask").any()]
    assert seen
    for sample in seen:
        depth_m = rich.decode_output(sample, "depth")[rich.decode_output(sample, "mask") == 1]
        # Depth is along the camera's axis, 50 degrees off at the border; limbs reach out of the disc.
        assert depth_m.min() > 0.64 * rich.truth["human_distance_m"][sample] - 0.8
    assert validate(out).ok
    with pytest.raises(RunError, match=r"config \(renderer\) differ"):
        generate(GenerateOptions(scene=str(scene), out=out, episodes=1, workers=0, config=config, json=True))


def test_running_again_on_a_complete_folder_changes_nothing(in_one_process: Path, scene: Path, config: Path) -> None:
    before = {path.name: path.read_bytes() for path in in_one_process.glob("shard-*")}
    generate(
        GenerateOptions(scene=str(scene), out=in_one_process, episodes=EPISODES, workers=0, config=config, json=True)
    )
    assert {path.name: path.read_bytes() for path in in_one_process.glob("shard-*")} == before


def test_folder_of_another_run_is_refused_by_name(in_one_process: Path, scene: Path, config: Path) -> None:
    with pytest.raises(RunError, match="holds data of another run: seed differ"):
        generate(
            GenerateOptions(scene=str(scene), out=in_one_process, episodes=EPISODES, workers=0, config=config, seed=1)
        )
    with pytest.raises(RunError, match=r"config \(episode\) differ"):
        generate(GenerateOptions(scene=str(scene), out=in_one_process, episodes=EPISODES, workers=0))


def test_folder_with_foreign_files_is_refused(tmp_path: Path, scene: Path) -> None:
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(RunError, match="holds files of something else"):
        generate(GenerateOptions(scene=str(scene), out=tmp_path, episodes=1, workers=0))


@pytest.mark.slow
def test_interrupted_fleet_leaves_nothing_behind_and_resumes_to_the_same_bytes(
    in_one_process: Path, scene: Path, config: Path, tmp_path: Path
) -> None:
    out = tmp_path / "one"
    command = _command(scene, config, out, workers=1)
    # A job in a shell's background ignores Ctrl-C, and so would its children.
    listen = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    run = subprocess.Popen(command, cwd=ROOT, text=True, preexec_fn=listen, **pipes)
    wait_for(lambda: _rendering(out), timeout_s=90.0)
    workers = workers_below(run.pid)
    assert len(workers) == 6
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert run.returncode == 130
    assert errors.strip().splitlines()[-1].startswith("readygo: stopped")
    assert not [pid for pid, _ in workers if Path(f"/proc/{pid}").exists()]
    assert not list(out.glob("*.part"))
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=200)
    assert _digests(out) == _digests(in_one_process)


def test_port_in_use_exits_with_2_and_one_line(scene: Path, config: Path, tmp_path: Path) -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        command = [*_command(scene, config, tmp_path / "data", workers=1), "--listen", endpoint]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert (
        done.stderr == f"readygo: Cannot listen on {endpoint}: the port is in use; choose another --listen endpoint.\n"
    )


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ({"episodes": 0}, "--episodes must be 1..10000000, got 0."),
        ({"episodes": 10**12}, "--episodes must be 1..10000000, got 1000000000000."),
        ({"workers": 257}, "--workers must be 0..256, got 257."),
    ],
)
def test_count_that_cannot_be_is_refused_before_anything_is_made_or_shown(
    counts: dict[str, int], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RunError, match=f"^{re.escape(words)}$"):
        generate(GenerateOptions(scene="a scene that is not there", out=tmp_path / "out", **counts))  # type: ignore[arg-type]
    assert capsys.readouterr() == ("", "")
    assert not (tmp_path / "out").exists()


def test_file_is_no_data_folder_and_no_progress_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"^--out .*file is a file; choose a new folder"):
        generate(GenerateOptions(scene="embedded", out=tmp_path / "file", episodes=1, workers=0))
    assert capsys.readouterr() == ("", "")


def test_missing_packages_of_an_option_are_said_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "prometheus_client"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    with pytest.raises(ConfigError, match="--metrics needs prometheus-client"):
        generate(GenerateOptions(scene="embedded", out=tmp_path / "out", observe=Observing(metrics="127.0.0.1:0")))
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("small") / "small.toml"
    path.write_text(
        "[episode]\ngoal_distance_min_m = 1.5\ngoal_distance_max_m = 2.5\ntime_limit_s = 3.0\n"
        "[robot.camera]\nheight_px = 8\nwidth_px = 10\n[driver]\ncamera_hz = 4.0\n"
    )
    return path


@pytest.fixture(scope="module")
def teacher(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_state_policy(tmp_path_factory.mktemp("teacher"), robot=ROBOT)


@pytest.fixture(scope="module")
def taught(scene: Path, small: Path, teacher: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "taught"
    recording = RecordingOptions(teacher=teacher)
    generate(
        GenerateOptions(scene=str(scene), out=out, episodes=3, workers=0, config=small, json=True, recording=recording)
    )
    return out


def test_teacher_drives_and_labels_and_the_data_name_it(taught: Path, teacher: Path) -> None:
    dataset, spec = Dataset([taught]), RunFolder(taught).load()[0]
    assert spec.teacher is not None
    assert dataset.provenance.teacher == TeacherOrigin(sha256=spec.teacher.sha256)
    assert {entry.driver for entry in dataset.episodes} == {DriverKind.EXPERT}
    labelled = np.flatnonzero(dataset.pictured)
    assert len(labelled) > 20
    assert np.array_equal(dataset.expert_actions[labelled], dataset.actions[labelled])
    assert validate(taught).ok


def test_run_with_a_teacher_is_recorded_again_to_the_same_bytes(taught: Path, tmp_path: Path) -> None:
    again = RecordingOptions(again=taught)
    generate(GenerateOptions(out=tmp_path / "again", workers=0, json=True, recording=again))
    assert _digests(tmp_path / "again") == _digests(taught)


def test_teacher_labels_what_a_policy_drives(taught: Path, scene: Path, small: Path, teacher: Path, tmp_path: Path):
    policy, labels = write_policy(tmp_path / "policy"), {}
    for name, by in (("taught", teacher), ("expert", None)):
        out, recording = tmp_path / name, RecordingOptions(teacher=by, mix=1.0)
        options = {"episodes": 1, "workers": 0, "config": small, "json": True, "recording": recording}
        generate(GenerateOptions(scene=str(scene), out=out, policy=policy, **options))
        dataset = Dataset([out])
        assert [entry.driver for entry in dataset.episodes] == [DriverKind.POLICY]
        labels[name] = dataset.expert_actions[dataset.pictured], dataset.actions
    assert np.array_equal(labels["taught"][1], labels["expert"][1])
    assert not np.array_equal(labels["taught"][0], labels["expert"][0])


def test_expert_among_tracked_people_labels_and_the_data_name_it(scene: Path, small: Path, tmp_path: Path) -> None:
    data, again = tmp_path / "data", tmp_path / "again"
    recording = RecordingOptions(teacher=Path("expert-tracked"))
    generate(
        GenerateOptions(scene=str(scene), out=data, episodes=1, workers=0, config=small, json=True, recording=recording)
    )
    generate(GenerateOptions(out=again, workers=0, json=True, recording=RecordingOptions(again=data)))
    dataset = Dataset([data])
    assert dataset.provenance.teacher == TeacherOrigin(kind="expert-tracked")
    labelled = np.flatnonzero(dataset.pictured)
    assert np.array_equal(dataset.expert_actions[labelled], dataset.actions[labelled])
    assert _digests(again) == _digests(data)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["SCENE", "--teacher", "nowhere"], "--teacher: nowhere holds no state policy; train one: readygo rl SCENE"),
        (["SCENE", "--teacher", "TEACHER"], "--teacher: it was trained for another robot (its cameras show something"),
        (["--again", "DATA", "--teacher", "TEACHER"], "--again takes scene and settings from the recorded run: leave"),
    ],
)
def test_teacher_that_does_not_fit_is_one_line_and_leaves_nothing(
    arguments: list[str], message: str, taught: Path, scene: Path, small: Path, teacher: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    places = {"SCENE": scene, "TEACHER": teacher, "SMALL": small, "DATA": taught}
    words = [str(places.get(word, word)) for word in arguments]
    monkeypatch.setattr(sys, "argv", ["readygo", "generate", *words, "--out", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as exit_info:
        main()
    assert exit_info.value.code == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "run").exists()


SUMMARY = {"episodes": 7, "samples": 1234, "wall_s": 5.67, "rejected": {"timeout": 2, "no <path>": 1}}


@pytest.mark.parametrize(
    ("where", "words"),
    [
        ({"on": "local", "slurm": "-p short"}, "--slurm has options of sbatch"),
        ({"on": "slurm", "workers": 0, "listen": "tcp/10.0.0.5:1"}, "--workers of at least 1"),
        ({"on": "slurm"}, "needs --listen"),
        ({"on": "local", "connect": "tcp/10.0.0.5:1"}, "add --on hosts"),
        ({"on": "local", "workers": 0, "watch": True}, "--watch needs a fleet"),
        ({"on": "hosts"}, "Name one of --listen"),
        ({"on": "hosts", "workers": 8, "listen": "tls/10.0.0.5:1"}, "starts no workers: leave out --workers"),
        ({"on": "hosts", "json": True, "listen": "tls/10.0.0.5:1"}, "has no summary for --json"),
        ({"on": "local", "workers": 0}, ""),
        ({"on": "local", "workers": 1, "watch": True}, ""),
        ({"on": "slurm", "listen": "tcp/10.0.0.5:1", "slurm": "-p short"}, ""),
        ({"on": "hosts", "workers": 0, "watch": True, "listen": "tls/10.0.0.5:1"}, ""),
        ({"on": "hosts", "connect": "tls/10.0.0.5:1"}, ""),
    ],
)
def test_places_of_workers_that_do_not_go_together_are_refused(where: dict[str, object], words: str) -> None:
    place = {name: where[name] for name in ("on", "slurm") if name in where}
    fleet = {name: where[name] for name in ("listen", "connect") if name in where}
    options = GenerateOptions(
        out=Path("out"),
        workers=int(str(where.get("workers", 1))),
        watch=bool(where.get("watch", False)),
        json=bool(where.get("json", False)),
        place=PlaceOptions(**place),  # type: ignore[arg-type]
        fleet=FleetOptions(**fleet),  # type: ignore[arg-type]
    )
    if not words:
        _check_place(options)
        return
    with pytest.raises((RunError, CertificateError), match=words):
        _check_place(options)


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, object]]:
    """What `record` is asked for; the dataset that it makes is none."""
    asked: list[dict[str, object]] = []

    def record(spec: object, out: Path, **options: object) -> dict[str, object]:
        asked.append({"spec": spec, "out": out, **options})
        return SUMMARY

    clarity = SimpleNamespace(to_mapping=lambda: {"sharp": 3}, warnings=lambda: ["it is foggy."])
    monkeypatch.setattr(command, "record", record)
    monkeypatch.setattr(command, "run_clarity", lambda spec, out: clarity)
    return asked


def test_run_is_recorded_where_it_was_asked_for_and_told_in_a_few_lines(
    recorded: list[dict[str, object]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, certs = tmp_path / "data", tmp_path / "certs"
    options = GenerateOptions(
        out=out,
        workers=3,
        fleet=FleetOptions(listen="tls/lab:7447", certs=certs),
        place=PlaceOptions(on="slurm", slurm="-p short"),
    )
    _record(SPEC, 9, options)
    (asked,) = recorded
    asked.pop("show")
    assert asked == {
        "spec": SPEC, "out": out, "episodes": 9, "workers": 3, "listen": "tls/lab:7447", "slurm": "-p short",
        "certs": certs, "observing": options.observe,
    }  # fmt: skip
    assert capsys.readouterr().err.splitlines()[-6:] == [
        f"7 episodes, 1,234 samples in {out} (5.7 s).",
        "  rejected 2: timeout",
        "  rejected 1: no <path>",
        "Warning: it is foggy.",
        f"Next: readygo validate {out} && readygo train {out} --out policy",
        f"What it covers: readygo coverage {out} --out coverage",
    ]
    _record(SPEC, 9, GenerateOptions(out=out, json=True))
    said = capsys.readouterr()
    assert json.loads(said.out) == {**SUMMARY, "clarity": {"sharp": 3}}
    assert said.err == ""


def test_run_on_other_hosts_is_led_from_here_without_workers(
    recorded: list[dict[str, object]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    begun, led = [], []
    monkeypatch.setattr(command, "begin", lambda *words: begun.append(words))
    monkeypatch.setattr(command, "lead_run", lambda folder, fleet, **more: led.append((folder.path, fleet, more)))
    monkeypatch.setattr(command, "begin_logging", lambda *_, **__: pytest.fail("the coordinator begins it"))
    fleet, observe = FleetOptions(connect="tcp/lab:7447"), Observing(log_format="json")
    options = GenerateOptions(out=tmp_path, fleet=fleet, place=PlaceOptions(on="hosts"), observe=observe)
    _record(SPEC, 5, options)
    assert begun == [(SPEC, tmp_path, 5)]
    assert led == [(tmp_path, fleet, {"strict": False, "observing": options.observe})]
    assert recorded == []
    assert capsys.readouterr().err == (
        f"More workers can join: READYGO_TOKEN=$(tail -1 {RunFolder(tmp_path).state / 'endpoint'}) "
        f"readygo worker {SPEC.stages[-1].role} --connect tcp/lab:7447 --run {SPEC.run}\n"
    )


@pytest.mark.parametrize("log_format", ["json", "text"])
def test_logs_of_this_process_have_the_format_that_was_asked_for(
    recorded: list[dict[str, object]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, log_format: Literal["json"]
) -> None:
    begun: list[tuple[object, ...]] = []
    monkeypatch.setattr(command, "begin_logging", lambda *how, **whose: begun.append((*how, *whose.values())))
    observe = Observing(log_format=log_format)
    _record(SPEC, 9, GenerateOptions(out=tmp_path, workers=0, json=True, observe=observe))
    assert begun == ([("json", SPEC.run, "launcher", "launcher")] if log_format == "json" else [])


def test_progress_tells_samples_a_second_of_this_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(command, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    status = StatusReply(
        wanted=9, committed=2, samples=1000, waiting={}, leased={}, rejected={"a": 2, "b": 3}, requeued=0, cpu_s={},
        finished=False,
    )  # fmt: skip
    with progress_bar(first_words="Workers can join.") as show:
        show(status)
        now_s[0] = 104.0
        show(dataclasses.replace(status, committed=4, samples=1600, trouble="full"))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "Workers can join."
    assert lines[-1].startswith("episodes 4/9 150 samples/s, 5 rejected, ETA ")
    assert lines[-1].endswith(" full")
