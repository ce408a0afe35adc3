"""Makes the spec of a run from its settings."""

import dataclasses
from pathlib import Path

from readygo.common.avatars.cast import load_cast, split_cast
from readygo.common.avatars.file import avatar_hash, avatar_paths
from readygo.common.dataset.provenance import AvatarOrigin, ScenarioOrigin, SceneOrigin
from readygo.common.errors import ConfigError, RunError
from readygo.common.maps import clearance_m, farthest_m, free_components
from readygo.common.messages import FileRef, RunSpec, Split
from readygo.common.scenes import Scene
from readygo.common.scenes.findings import goals_line
from readygo.runs.config import RunConfig, check_cameras, resolved_sections
from readygo.runs.identity import run_metadata, run_name
from readygo.runs.policy import file_ref
from readygo.runs.world import World
from readygo.services.planner import CELL_MARGIN_M, load_scenarios, read_text, text_hash


def episode_count(scenarios: Path | None) -> int:
    """Default number of episodes: one for each scenario of a file, else 100."""
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
    """Make the spec of a run.

    Raises:
        RunError: If the seed is out of range, or the scene has no goal at the required distance from a start.
        ConfigError: If the robot's camera cannot have the sensor's lens, or a scenario cannot take place in the scene.
    """
    if not 0 <= seed < 2**63:
        raise RunError(f"--seed must be 0..2^63-1, got {seed}.")
    check_cameras(config)
    config = _with_weights_named(config)
    humans = {} if static else load_cast(avatars)
    avatars, _ = split_cast(avatars)
    script = read_text(scenarios) if scenarios else ""
    spec = RunSpec(
        run="",
        scene_path=str(scene.path.resolve()),
        scene_hash=scene.content_hash,
        scene_files=tuple(FileRef(path=f.path, sha256=f.sha256, size=f.size) for f in scene.files),
        avatars_path=str(avatars.resolve()) if avatars else "",
        avatar_files=tuple(file_ref(path.parent, path.name) for path in avatar_paths(avatars)) if avatars else (),
        avatar_hashes={name: avatar_hash(avatar) for name, avatar in humans.items()},
        seed=seed,
        split=split,
        static=static,
        config=resolved_sections(config),
        metadata=run_metadata(
            config,
            scene=SceneOrigin(name=scene.name, hash=scene.content_hash, license=scene.license),
            avatars={n: AvatarOrigin(hash=avatar_hash(a), license=a.license) for n, a in humans.items()},
            scenarios=ScenarioOrigin(name=scenarios.name, sha256=text_hash(script)) if scenarios else None,
        ),
        scenarios=script,
    )
    # Raises for impossible scenarios, before anything is started or written.
    if scenarios:
        World(spec).human_planner()
    else:
        _refuse_without_room(scene, config)
    return dataclasses.replace(spec, run=run_name(spec))


def _with_weights_named(config: RunConfig) -> RunConfig:
    """The configuration with the digest of a motion model's files, so that workers with different files are refused."""
    if config.animator.source != "priormdm":
        return config
    from readygo.services.animator import files_digest

    try:
        config.animator.priormdm.check_named()
    except ValueError as error:
        raise ConfigError(f"{error}") from error
    model = dataclasses.replace(config.animator.priormdm, sha256=files_digest(config.animator.priormdm))
    return dataclasses.replace(config, animator=dataclasses.replace(config.animator, priormdm=model))


def _refuse_without_room(scene: Scene, config: RunConfig) -> None:
    robot_map, radius_m = scene.maps.robot, config.robot.widest.planning_radius_m
    labels, _ = free_components(clearance_m(robot_map) > radius_m + CELL_MARGIN_M)
    reach_m = farthest_m(labels, robot_map.frame.resolution_m)
    if line := goals_line(reach_m, config.episode.goal_distance_min_m, radius_m):
        raise RunError(f"Scene {scene.name}: {line}")
