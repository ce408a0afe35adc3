"""Replay of one episode of an evaluation from the files in its folder."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from readygo.apps.evaluation.replay import PERCEIVING, Replays
from readygo.common.errors import MessageError, RunError, cause
from readygo.common.files import write_whole
from readygo.common.messages import RunSpec, decode, encode
from readygo.common.perception import load_perception
from readygo.runs.evaluation import make_evaluator
from readygo.runs.identity import identity
from readygo.runs.methods import CHECKPOINTS, PERCEPTION
from readygo.runs.world import World
from readygo.services.evaluator import EXPERT, POLICY, EpisodeRecord, Results, as_task, read_results

SPEC_FILE = "spec.msgpack"
"""File with the places of scene and avatars, and all settings."""


def keep_spec(folder: Path, spec: RunSpec) -> None:
    """Write the spec of an evaluation: scene, avatars and settings.

    Raises:
        ReadygoError: If the file cannot be written.
    """
    write_whole(folder / SPEC_FILE, encode(spec))


def plan_command(folder: Path, record: EpisodeRecord) -> str:
    """The `readygo plan` command line that replays an episode."""
    chosen = ["--task", record.task.value, "--method", record.method]
    words = ["readygo", "plan", "--from", str(folder), record.episode.episode_id, *chosen, "--picture", "episode.png"]
    return shlex.join(words)


@contextmanager
def kept_episode(
    folder: Path, episode: str, task: str = "", method: str = "", *, checkpoints: Path = CHECKPOINTS
) -> Iterator[tuple[Replays, EpisodeRecord]]:
    """Open an episode of a finished evaluation, for a replay.

    Args:
        folder: Folder of the evaluation.
        episode: Name of the episode, such as test-0-000003.
        task: Task of the episode; may be empty if the evaluation has only one.
        method: Driver of the episode; if empty, the policy, else the expert, else the only one.
        checkpoints: Folder that may hold the network of the methods that perceive.

    Raises:
        RunError: If the folder has no such episode, or scene or avatars have changed since the evaluation.
    """
    with read_results(folder) as results:
        record = _find_record(results, episode, task, method)
        world = World(_read_spec(folder))
        _check_world(world, results)
        evaluator = make_evaluator(world, methods={})
        dynamic, reason = evaluator.source().among_humans(record.episode)
        if dynamic is None:
            raise RunError(f"{episode} has no scenario here ({reason}): this version or machine plans differently.")
        driven = as_task(dynamic, record.task)
        network = checkpoints / PERCEPTION
        shows = record.method in PERCEIVING and network.is_dir()
        replays = Replays(
            world,
            results,
            [driven],
            None,
            evaluator.simulation,
            sees=results.sees(),
            perception=load_perception(network, robot=world.config.robot) if shows else None,
        )
        if not replays.load([record]):
            raise RunError(f"{folder} does not keep what {episode} was driven with.")
        yield replays, record


def _find_record(results: Results, episode: str, task: str, method: str) -> EpisodeRecord:
    of_episode = [record for record in results.records.values() if record.episode.episode_id == episode]
    if not of_episode:
        known = sorted({record.episode.episode_id for record in results.records.values()})
        example = f"; it has {known[0]} to {known[-1]}" if known else ""
        raise RunError(f"{results.folder} has no episode {episode!r}{example}.")
    methods = [record.method for record in of_episode]
    method = method or next((name for name in (POLICY, EXPERT) if name in methods), methods[0])
    found = [record for record in of_episode if record.method == method and task in ("", record.task.value)]
    if len(found) != 1:
        choices = ", ".join(sorted({f"--task {record.task.value} --method {record.method}" for record in of_episode}))
        raise RunError(f"{results.folder} has {len(found)} such episodes {episode}; choose one of: {choices}.")
    return found[0]


def _read_spec(folder: Path) -> RunSpec:
    path = folder / SPEC_FILE
    try:
        return decode(RunSpec, path.read_bytes())
    except FileNotFoundError as error:
        raise RunError(f"{folder} does not say where it was driven; let `readygo evaluate` finish into it.") from error
    except (OSError, MessageError) as error:
        raise RunError(f"{path} cannot be read: {cause(error)}") from error


def _check_world(world: World, results: Results) -> None:
    """Raise RunError unless the spec belongs to the folder's evaluation."""
    settings = results.settings()
    own = {name: settings.get(name) for name in ("scene", "avatars", "scenarios", "config")}
    ours = {name: value for name, value in identity(world.spec).items() if name in own}
    if different := sorted(name for name in own if own[name] != ours[name]):
        raise RunError(f"{results.folder / SPEC_FILE} is of another evaluation: {', '.join(different)} differ.")
