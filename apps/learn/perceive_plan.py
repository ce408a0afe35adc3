"""Plan of a run of `readygo learn` in the form "perceive": settings, avatars and folder."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.learn.plan import LOCK_FILE, state_of
from readygo.common.avatars.cast import learned_and_tested
from readygo.common.cores import available_cores
from readygo.common.documents import write_json
from readygo.common.errors import ConfigError, RunError
from readygo.common.robot import RobotConfig, load_robot
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.folder import check_new
from readygo.runs.methods import PERCEPTION
from readygo.runs.scene_argument import open_scenes
from readygo.runs.sections import NO_KEYS, Keys
from readygo.services.driver import DriverConfig
from readygo.services.renderer import RendererConfig

FORMAT = "readygo-perceive/4"
ROBOT = RobotConfig()
STATE_FILE = "perceive.json"
SETTINGS_FILE = "settings.toml"
"""The settings of the test, for `--config`."""
VARIANTS_A_MINUTE, VARIANTS = 4, (56, 200)
"""Varied avatars that walk in the data: per minute of the run; at least, and at most. Each takes about 1 s."""
CAMERA_HZ = 5.0
"""Images a second: perception sees images that are 0.2 s apart."""
DISTURBED = 0.7
"""Share of the expert's episodes with noise injection: perception must know views off the expert's way."""


@dataclass(frozen=True, kw_only=True)
class PerceivePlan:
    """Scenes, settings, budget and folder of a run."""

    out: Path
    scenes: tuple[str, ...]
    config: RunConfig
    minutes: float
    """Wall time of recording and training [min]."""
    avatars: Path | None
    """Avatars of the run; None for the embedded ones. Some are kept for the test, see `learned_and_tested`."""
    seed: int
    policy_on_states: bool = True
    """Train a policy on states beside, where there is a second core."""

    @property
    def perception(self) -> Path:
        """Folder of the network."""
        return self.out / PERCEPTION

    @property
    def learned(self) -> Path | None:
        """Avatars that are varied for the data, and walk on the split val."""
        return learned_and_tested(self.avatars)[0]

    @property
    def tested(self) -> Path | None:
        """Avatars that walk in the test."""
        return learned_and_tested(self.avatars)[1]

    @property
    def people(self) -> Path:
        """Folder of the varied avatars that walk in the data."""
        return self.out / "people"


def perceive_settings(
    config: Path | None, robot: Path | None, keys: Keys = NO_KEYS, *, usual: RobotConfig = ROBOT
) -> RunConfig:
    """The settings of the recording runs: levels of detail, no labels, noise injection.

    Args:
        config: TOML file with sections of settings.
        robot: The robot's file.
        keys: Keys of the command line, by section.
        usual: The robot if no file has one; also the camera of a robot's file that has none.

    Raises:
        ConfigError: If a file cannot be read or holds an unknown key or a wrong value.
    """
    own = load_robot(robot, cameras_of=usual) if robot else None
    base = RunConfig(
        robot=usual,
        driver=DriverConfig(disturbed=DISTURBED, camera_hz=CAMERA_HZ),
        renderer=RendererConfig(detail="lod", labels=False),
    )
    return load_run_config(config, own, base=base, keys=keys)


def check_plan(plan: PerceivePlan) -> None:
    """Check a plan before anything is written.

    Raises:
        RunError: If the budget is none, no scene is named, or one twice, or the folder holds something else.
        SceneError: If there is no such scene.
        AvatarError: If there are no avatars.
        ConfigError: If perception cannot be trained for the robot.
    """
    if not plan.minutes > 0:
        raise RunError(f"--minutes must be above 0, got {plan.minutes:g}.")
    if reason := not_one_camera(plan.config.robot):
        raise ConfigError(f"--form perceive is for one robot with one camera, not for {reason}: use --form policy.")
    hashes = [scene.content_hash for scene in open_scenes(plan.scenes)]
    # Avatars that are missing end here.
    learned_and_tested(plan.avatars)
    state = plan.out / STATE_FILE
    if state.exists():
        theirs = read_state(plan).get("scenes")
        if theirs != hashes:
            raise RunError(f"{plan.out} learns in other scenes; choose another --out.")
    else:
        check_new(plan.out, LOCK_FILE)


def not_one_camera(robot: RobotConfig) -> str:
    """What keeps perception from being trained for a robot; empty if nothing does."""
    return "a robot of ranges" if robot.ranges.varies else "several cameras" if robot.cameras else ""


def read_state(plan: PerceivePlan) -> dict[str, Any]:
    """What the run has done; empty for a new one.

    Raises:
        RunError: If the file is broken.
    """
    return state_of(plan.out / STATE_FILE, FORMAT)


def write_state(plan: PerceivePlan, state: Mapping[str, Any]) -> None:
    """Write what the run has done."""
    write_json(plan.out / STATE_FILE, state, raises=RunError)


def tested_settings(config: RunConfig) -> RunConfig:
    """The settings of a run as its driver is tested: the rates and disturbances of recording are not part of it."""
    return dataclasses.replace(config, driver=DriverConfig())


def variants_of(minutes: float) -> int:
    """Number of varied avatars of a new run."""
    least, most = VARIANTS
    return max(least, min(int(VARIANTS_A_MINUTE * minutes), most))


def has_policy_on_states(plan: PerceivePlan) -> bool:
    """True if a policy on states is trained beside: on a separate core."""
    return plan.policy_on_states and available_cores() > 1


def workers_of(plan: PerceivePlan) -> int:
    """Cores for recording and training."""
    return available_cores() - has_policy_on_states(plan)
