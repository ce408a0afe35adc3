"""`readygo generate`: from a scene to a recorded dataset."""

import dataclasses
import json as json_module
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from readygo.apps.commands.scene_argument import open_scene
from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.worker import make_coordinator
from readygo.apps.run.config import (
    RunConfig,
    RunFolder,
    load_run_config,
    numeric_class,
    resolved_sections,
    run_metadata,
    run_name,
)
from readygo.apps.run.stages import stage_work
from readygo.apps.run.world import World
from readygo.common.avatars import load_avatars
from readygo.common.avatars.file import avatar_hash
from readygo.common.bus import InProcessBus, claim_once
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.dataset.provenance import AvatarOrigin, Provenance, ScenarioOrigin, SceneOrigin
from readygo.common.errors import BusError, ConfigError, RunError
from readygo.common.messages import FileRef, RunSpec, Split, Stage, StatusReply, StatusRequest
from readygo.common.robot import load_robot
from readygo.common.scenes import Scene
from readygo.services import coordinator as coordination
from readygo.services.planner.humans.recipes import PeopleName
from readygo.services.planner.humans.scenario_file import load_scenarios, read_text, text_hash
from readygo.services.recorder import Recorder
from readygo.services.recorder import attach as attach_recorder
from readygo.services.renderer.sensor.config import SensorName
from readygo.services.renderer.sensor.lens import check_sensor

Show = Callable[[StatusReply], None]
POLL_S = 0.25


def generate(
    scene: str,
    /,
    *,
    out: Path,
    episodes: int | None = None,
    workers: int = 1,
    split: Literal["train", "val", "test"] = "train",
    seed: int = 0,
    avatars: Path | None = None,
    static: bool = False,
    people: PeopleName | None = None,
    scenarios: Path | None = None,
    outputs: str = "",
    detail: Literal["exact", "lod"] | None = None,
    robot: Path | None = None,
    config: Path | None = None,
    sensor: SensorName | None = None,
    listen: str = "",
    json: bool = False,
) -> None:
    """Record episodes of an expert among walking people; run again to resume.

    Args:
        scene: Scene bundle, or "embedded".
        out: Data folder; shards appear in it.
        episodes: Episodes to record; 100, or as many as the scenario file has entries.
        workers: Renderer processes, besides one process for each other role; 0 does everything in this process.
        split: Random streams to draw the episodes from; train, val and test never share an episode.
        seed: Seed of the run.
        avatars: Avatar file or folder of them; the embedded ones by default.
        static: Leave the humans out.
        people: Recipe of how many people come and how they meet the robot, in place of what `config` says of it;
            "paper" by default.
        scenarios: TOML file with starts, goals and people to play instead of drawing them, one entry after the other.
        outputs: Images to record, separated by commas, of rgb, depth, median_depth, alpha, mask and normal, such as
            rgb,depth,mask; rgb alone by default.
        detail: "lod" draws far things and people with fewer Gaussians, about twice as fast; as in `config`, or
            "exact", by default.
        robot: robot.toml of another robot.
        config: TOML file with sections of settings.
        sensor: Recipe of the camera's lens and sensor, in place of the section [renderer.sensor] of `config`.
        listen: Endpoint of the fleet's router, such as tcp/127.0.0.1:7447, for workers that are started by hand; a
            free loopback port by default.
        json: Print the summary as JSON.
    """
    run_config = load_run_config(config, load_robot(robot) if robot else None, sensor, people)
    if outputs:
        run_config = with_outputs(run_config, outputs)
    if detail:
        run_config = with_detail(run_config, detail)
    spec = make_spec(
        open_scene(scene), avatars, run_config, seed=seed, split=Split(split), static=static, scenarios=scenarios
    )
    wanted = episode_count(scenarios) if episodes is None else episodes
    summary = record(spec, out, episodes=wanted, workers=workers, listen=listen, quiet=json)
    if json:
        sys.stdout.write(json_module.dumps(summary) + "\n")
        return
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(f"{summary['episodes']} episodes, {summary['samples']} samples in {out} ({summary['wall_s']:.1f} s).")
    for reason, count in summary["rejected"].items():
        console.print(f"  rejected {count}: {reason}", markup=False)
    console.print(f"Next: readygo validate {out} && readygo train {out} --out policy", markup=False)
    console.print(f"What it covers: readygo coverage {out} --out coverage", markup=False)


def with_outputs(config: RunConfig, names: str) -> RunConfig:
    """The configuration with other recorded images.

    Args:
        config: A configuration.
        names: Names of the images, separated by commas.

    Raises:
        ConfigError: If a name is unknown, or rgb is missing.
    """
    try:
        renderer = dataclasses.replace(config.renderer, outputs=tuple(name.strip() for name in names.split(",")))
    except ValueError as error:
        raise ConfigError(f"--{error}") from error
    return dataclasses.replace(config, renderer=renderer)


def with_detail(config: RunConfig, detail: Literal["exact", "lod"]) -> RunConfig:
    """The configuration with another level of detail.

    Raises:
        ConfigError: If the configuration's backend has none.
    """
    try:
        renderer = dataclasses.replace(config.renderer, detail=detail)
    except ValueError as error:
        raise ConfigError(f"--detail: {error}") from error
    return dataclasses.replace(config, renderer=renderer)


def record(
    spec: RunSpec, out: Path, *, episodes: int, workers: int, listen: str = "", quiet: bool = False
) -> dict[str, Any]:
    """Do a run, or the rest of it.

    Args:
        spec: What the run is.
        out: Its data folder.
        episodes: Episodes that the folder shall hold.
        workers: Renderer processes of the fleet; 0 does everything in this process.
        listen: Endpoint of the fleet's router; empty takes a free loopback port.
        quiet: True shows no progress.

    Returns:
        What was done and what it cost, as plain values.

    Raises:
        RunError: If the run cannot be done; what is recorded stays.
    """
    if episodes < 1 or not 0 <= workers <= 256:
        raise RunError(f"--episodes must be at least 1 and --workers 0..256, got {episodes} and {workers}.")
    folder = RunFolder(out)
    folder.check(spec)
    begin_s = time.monotonic()
    with folder.locked():
        recorded, samples_before = _recorded(folder, episodes)
        folder.save(spec, episodes)
        if listen and workers and not quiet:
            _say_how_to_join(listen, spec.run)
        with _progress(quiet=quiet) as show:
            if workers == 0 or recorded == episodes:
                status = run_in_process(folder, show)
            else:
                status = run_fleet(folder, workers, listen or free_endpoint(), show)
    if status.failed:
        raise RunError(f"{status.failed} ({status.committed} of {status.wanted} episodes are recorded.)")
    return _summary(out, status, samples_before, time.monotonic() - begin_s)


def episode_count(scenarios: Path | None) -> int:
    """How many episodes there are if nobody says how many: one for each scenario of a file, else 100."""
    return len(load_scenarios(scenarios).entries) if scenarios else 100


def make_spec(
    scene: Scene,
    avatars: Path | None,
    config: RunConfig,
    *,
    seed: int,
    split: Split,
    static: bool,
    scenarios: Path | None = None,
) -> RunSpec:
    """The run of these settings.

    Raises:
        RunError: If the seed cannot be recorded.
        ConfigError: If the robot's camera cannot have the sensor's lens, or a scenario cannot take place in the scene.
    """
    if not 0 <= seed < 2**63:
        raise RunError(f"--seed must be 0..2^63-1, got {seed}.")
    check_sensor(config.renderer.sensor, config.robot.camera)
    config = _with_weights_named(config)
    people = {} if static else load_avatars(avatars)
    script = read_text(scenarios) if scenarios else ""
    spec = RunSpec(
        run="",
        scene_path=str(scene.path.resolve()),
        scene_hash=scene.content_hash,
        scene_files=tuple(FileRef(path=f.path, sha256=f.sha256, size=f.size) for f in scene.files),
        avatars_path=str(avatars.resolve()) if avatars else "",
        avatar_hashes={name: avatar_hash(avatar) for name, avatar in people.items()},
        seed=seed,
        split=split,
        static=static,
        config=resolved_sections(config),
        metadata=run_metadata(
            config,
            scene=SceneOrigin(name=scene.name, hash=scene.content_hash, license=scene.license),
            avatars={n: AvatarOrigin(hash=avatar_hash(a), license=a.license) for n, a in people.items()},
            scenarios=ScenarioOrigin(name=scenarios.name, sha256=text_hash(script)) if scenarios else None,
        ),
        scenarios=script,
    )
    if scenarios:
        # Refuses what cannot take place, before anything is started or written.
        World(spec).planner()
    return dataclasses.replace(spec, run=run_name(spec))


def _with_weights_named(config: RunConfig) -> RunConfig:
    """The configuration with the digest of a motion model's files, so that workers with others are refused."""
    if config.animator.source != "priormdm":
        return config
    from readygo.services.animator.priormdm.checkpoint import files_digest

    try:
        config.animator.priormdm.check_named()
    except ValueError as error:
        raise ConfigError(f"{error}") from error
    model = dataclasses.replace(config.animator.priormdm, sha256=files_digest(config.animator.priormdm))
    return dataclasses.replace(config, animator=dataclasses.replace(config.animator, priormdm=model))


def run_in_process(folder: RunFolder, show: Show) -> StatusReply:
    """Do all stages in this process, through the same handlers."""
    bus = InProcessBus()
    coordinator = make_coordinator(folder)
    coordination.attach(bus, coordinator)
    world = World(coordinator.spec, bus)
    recorder = Recorder(
        folder=folder.path, name="rec0", bus=bus, provenance=Provenance.of_run(world.spec), config=world.config.recorder
    )
    attach_recorder(bus, recorder)
    numbers = numeric_class(world.config)
    try:
        works = {} if coordinator.over else {stage: stage_work(stage, world, bus) for stage in reversed(Stage)}
        while not coordinator.over:
            # Later stages first: an episode is finished before the next one is begun.
            if all(claim_once(bus, stage, "in-process", numbers, work) == "wait" for stage, work in works.items()):
                raise RunError("No stage has work, yet the run is not finished; its ledger is damaged.")
            show(bus.request("ctl/status", StatusRequest(), StatusReply))
    finally:
        recorder.close()
    status = bus.request("ctl/status", StatusRequest(), StatusReply)
    coordinator.ledger.close()
    return status


def run_fleet(folder: RunFolder, workers: int, endpoint: str, show: Show) -> StatusReply:
    """Do the run with a local fleet over Zenoh."""
    spec, _ = folder.load()
    router = Router(endpoint)
    fleet = Fleet(connect=endpoint, run=spec.run, data=folder.path.resolve(), logs=folder.logs)
    bus = ZenohBus(endpoint, spec.run)
    try:
        fleet.add("coordinator", "coordinator")
        fleet.add("recorder", "rec0")
        for role in ("human-planner", "animator", "robot-planner"):
            fleet.add(role, f"{role}0")
        for number in range(workers):
            fleet.add("renderer", f"renderer{number}")
        status = _supervise(fleet, bus, show)
    finally:
        fleet.stop()
        bus.close()
        router.close()
    if status.finished:
        fleet.check_recorders()
    return status


def _supervise(fleet: Fleet, bus: ZenohBus, show: Show) -> StatusReply:
    heard_s = time.monotonic()
    while True:
        time.sleep(POLL_S)
        try:
            status = bus.request("ctl/status", StatusRequest(), StatusReply, timeout_s=2.0)
        except BusError:
            if time.monotonic() - heard_s > 60.0:
                raise
        else:
            heard_s = time.monotonic()
            show(status)
            if status.finished or status.failed:
                return status
        fleet.check()


def _recorded(folder: RunFolder, wanted: int) -> tuple[int, int]:
    """Durable episodes of the folder's run, and the samples in them; refuses to make the run shorter than they are."""
    if not folder.ledger.exists():
        return 0, 0
    ledger = coordination.Ledger(folder.ledger)
    (episodes, samples), wanted_min = ledger.committed(), ledger.wanted_min()
    ledger.close()
    if wanted_min > wanted:
        raise RunError(
            f"{folder.path} holds {episodes} episodes already, the last one is number {wanted_min} of its run; "
            f"ask for at least {wanted_min} with --episodes."
        )
    return episodes, samples


def _say_how_to_join(endpoint: str, run: str) -> None:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    console.print(f"More workers can join: readygo worker renderer --connect {endpoint} --run {run}", markup=False)


@contextmanager
def _progress(*, quiet: bool) -> Iterator[Show]:
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.0f} samples/s, {task.fields[rejected]} rejected, ETA"),
        TimeRemainingColumn(),
    )
    begin_s = time.monotonic()
    samples_before: int | None = None
    with Progress(*columns, console=Console(stderr=True), disable=quiet) as progress:
        task = progress.add_task("episodes", total=None, rate=0.0, rejected=0)

        def show(status: StatusReply) -> None:
            nonlocal samples_before
            if samples_before is None:
                samples_before = status.samples
            rate = (status.samples - samples_before) / max(time.monotonic() - begin_s, 1e-3)
            rejected = sum(status.rejected.values())
            progress.update(task, total=status.wanted, completed=status.committed, rate=rate, rejected=rejected)

        yield show


def _summary(out: Path, status: StatusReply, samples_before: int, wall_s: float) -> dict[str, Any]:
    return {
        "episodes": status.committed,
        "samples": status.samples,
        "wall_s": round(wall_s, 2),
        "samples_per_s": round((status.samples - samples_before) / wall_s, 1),
        "rejected": status.rejected,
        "requeued": status.requeued,
        "cpu_s": {stage: round(seconds, 2) for stage, seconds in status.cpu_s.items()},
        "data": str(out),
    }
