"""`readygo learn` in the form "paper": a policy from images to commands, without a map, in three parts.

RUN/perceive/   a run of the form "perceive" without a test: varied avatars, perception, and a policy on states
RUN/            a run of the form "policy" among these avatars: that perception is the encoder, that policy the teacher
RUN/refined/    perception trained on with all of these images, and a policy that learns with it
"""

from pathlib import Path

from readygo.apps.learn.config import load_learn_config
from readygo.apps.learn.perceive_plan import PerceivePlan, check_plan, perceive_settings, read_state
from readygo.apps.learn.plan import FIRST_FOLDER, SMALL_CAMERA, STATE, check_new_folder, learn_configs
from readygo.common.errors import ConfigError
from readygo.common.images.names import RGB
from readygo.common.messages import TeacherKind
from readygo.common.robot import RobotConfig
from readygo.common.state_policy.state_policy import is_state_policy
from readygo.runs.methods import RL
from readygo.runs.sections import Keys
from readygo.runs.teacher import tracked_ref

FIRST_SHARE, REFINED_SHARE = 0.4, 0.3
"""Shares of the time for the first and the third part."""
LEAST_SHARE = 0.2
"""Least share of the time for the second part: on a busy machine the first one takes longer."""


def first_plan(
    scenes: tuple[str, ...],
    out: Path,
    *,
    config: Path | None,
    robot: Path | None,
    keys: Keys,
    minutes: float,
    avatars: Path | None,
    seed: int,
) -> PerceivePlan:
    """The checked plan of the first part; writes nothing.

    Args:
        scenes: Scenes, each once.
        out: Folder of the whole run.
        config: TOML file with sections of settings.
        robot: The robot's file; a camera of 72x128 pixels by default.
        keys: Keys of the command line, by section.
        minutes: Wall time of the whole run [min].
        avatars: Avatars of the run; None for the embedded ones.
        seed: Seed of the episodes and of the training.

    Raises:
        ConfigError: If settings are wrong, or the policy would see more than the rgb of one camera.
        RunError: If a folder holds something else, or the budget is none.
        SceneError: If there is no such scene.
    """
    settings, learn = learn_configs(config, robot, "", "", keys=keys)
    if (learn.images, learn.goal) != ((RGB,), "point"):
        raise ConfigError('--form paper goes with the rgb of one camera and goal "point": use --form policy.')
    if learn.teacher == TeacherKind.EXPERT_TRACKED.value:
        tracked_ref(settings)
    of_runs = {name: section for name, section in keys.items() if name != "learn"}
    plan = PerceivePlan(
        out=out / FIRST_FOLDER,
        scenes=scenes,
        config=perceive_settings(config, robot, of_runs, usual=RobotConfig(camera=SMALL_CAMERA)),
        minutes=FIRST_SHARE * minutes,
        avatars=avatars,
        seed=seed,
        policy_on_states=learn.teacher == "rl",
    )
    if not (out / STATE).exists():
        check_new_folder(out)
    check_plan(plan)
    return plan


def policy_keys(keys: Keys, config: Path | None) -> Keys:
    """Keys of the second part: its policy has no memory, as the paper's, unless `[learn] memory` is given.

    Raises:
        ConfigError: If the file of settings cannot be read or holds an unknown key or a wrong value.
    """
    learn = keys.get("learn", {})
    if "memory" in learn or load_learn_config(config).memory is not None:
        return keys
    return {**keys, "learn": {**learn, "memory": 0}}


def teacher_of(first: PerceivePlan) -> Path | None:
    """Folder of the policy on states that the first part left; None if it left none or the expert is to teach."""
    folder = first.out / RL
    return folder if first.policy_on_states and is_state_policy(folder) else None


def minutes_after(first: PerceivePlan, minutes: float) -> float:
    """Wall time of the second part [min]: what the others leave of the whole, but at least `LEAST_SHARE` of it."""
    return max((1.0 - REFINED_SHARE) * minutes - float(read_state(first)["minutes"]), LEAST_SHARE * minutes)


def data_of(first: PerceivePlan) -> list[Path]:
    """Data folders of the first part."""
    return sorted((first.out / "data").iterdir())
