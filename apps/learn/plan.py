"""Plan of a learning run: the recording runs of its scenes, and its folder."""

import dataclasses
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.learn.config import GoalName, LearnConfig, load_learn_config
from readygo.common.avatars.cast import learned_and_tested
from readygo.common.camera import CameraConfig
from readygo.common.documents import read_json, write_json
from readygo.common.errors import ConfigError, RunError, SceneError, cause
from readygo.common.images.names import RGB, kind_of
from readygo.common.locks import held
from readygo.common.messages import EpisodeKey, HumanPlanRequest, RunSpec, Split, TeacherKind
from readygo.common.perception.artifact import WEIGHTS_FILE, load_perception_spec
from readygo.common.policy.sight import check_cameras
from readygo.common.robot import RobotConfig, load_robot
from readygo.runs.config import RunConfig, load_run_config
from readygo.runs.folder import RunFolder, check_new
from readygo.runs.policy import file_ref, with_offers
from readygo.runs.scene_argument import open_scenes
from readygo.runs.sections import NO_KEYS, Keys, with_keys
from readygo.runs.spec import make_spec
from readygo.runs.teacher import with_teacher
from readygo.runs.training import torch_needed
from readygo.runs.world import World
from readygo.services.driver import DriverConfig
from readygo.services.planner import HumanPlannerConfig, handle_human_plan
from readygo.services.renderer import RendererConfig
from readygo.services.trainer import RECIPES, SamplingConfig, chosen_images, with_overrides

FORMAT = "readygo-learn/1"
LOCK_FILE = ".lock"
FIRST_FOLDER = "perceive"
"""Folder of the run that comes first in the form "paper"."""
REFINED_FOLDER = "refined"
"""Folder of what perception and a policy learn last in the form "paper"."""
STATE = "learn.json"
"""File with the settings that must not change when the run resumes, and the time spent."""
SMALL_CAMERA = CameraConfig(height_px=72, width_px=128)
"""Default camera of a policy: half the usual image size, trained on three times as fast."""
ABSENT = 0.3
"""Share of the episodes without humans."""
ABSENT_FIRST = 600
"""Number of first episodes without humans, over all scenes: the policy learns the place first, then humans."""
DISTURBED = 0.5
"""Share of the expert's episodes with noise injection."""
IMAGE_EVERY_S = 0.25
"""Longest time from image to image [s]: neighbouring images are redundant, and rendering dominates the cost."""
DRAWS = 40
"""Number of scenarios to try before a scene counts as too small."""


@dataclass(frozen=True, kw_only=True)
class LearnPlace:
    """A scene, and its recording run."""

    name: str
    scene: str
    """Scene bundle, or "embedded"."""
    spec: RunSpec
    folder: RunFolder


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Budget of a learning run, which also ends when nothing improves any more."""

    minutes: float = 60.0
    """Wall time, including earlier commands [min]."""
    samples: int | None = None
    """Training budget in samples, repeats counted, instead of minutes: less dependent on the machine's load."""

    def share(self, minutes: float, samples: int) -> float:
        """Share of it that is spent after so many minutes and samples."""
        return minutes / self.minutes if self.samples is None else samples / self.samples


@dataclass(frozen=True, kw_only=True)
class LearnPlan:
    """Scenes, settings, budget and folder of a learning run."""

    out: Path
    places: tuple[LearnPlace, ...]
    config: RunConfig
    learn: LearnConfig
    budget: Budget
    avatars: Path | None
    """Avatars of the measurements during the run; those of the data as well, except in the form "paper"."""
    tested: Path | None
    """Avatars of the test."""
    seed: int
    perception: Path | None = None
    """Folder of trained perception whose network is the policy's encoder; None for an encoder that learns with it."""

    @property
    def recipe(self) -> str:
        """Recipe of the training."""
        return "pretrained" if self.perception else "best"

    def image_count(self, samples: int) -> int:
        """Estimated number of samples with an image among recorded samples, with an error of up to one per episode."""
        return samples // self.config.driver.image_every(self.config.robot.clock)

    @property
    def best(self) -> Path:
        """Folder of the policy with the best measurement so far."""
        return self.policy / "best"

    @property
    def policy(self) -> Path:
        """Folder of the policy and the trainer's state."""
        return self.out / "policy"

    @property
    def state_file(self) -> Path:
        """File with the settings that must not change when the run resumes, and the time spent."""
        return self.out / STATE

    @property
    def curve_file(self) -> Path:
        """File of the learning curve."""
        return self.out / "curve.json"


def learn_settings(
    config: Path | None,
    robot: Path | None,
    *,
    scene_count: int = 1,
    perception: Path | None = None,
    keys: Keys = NO_KEYS,
) -> RunConfig:
    """The settings of the recording runs, with defaults for training instead of those of `readygo generate`.

    Defaults: small images with levels of detail and without labels, few per second; first only episodes without
    humans, later a share of them; noise injection for the expert.

    Args:
        config: TOML file with sections of settings.
        robot: The robot's file.
        scene_count: Number of scenes that share the first episodes.
        perception: Folder of trained perception whose network is the encoder: its robot and frame spacing are the
            default.
        keys: Keys of the command line, by section.

    Raises:
        ConfigError: If a file cannot be read or holds an unknown key or a wrong value.
        PolicyError: If perception cannot be used.
    """
    usual, spacing_s = RobotConfig(camera=SMALL_CAMERA), SamplingConfig().frame_spacing_s
    if perception is not None:
        perceives = load_perception_spec(perception)
        usual, spacing_s = perceives.robot, perceives.spacing_s
    own = load_robot(robot, cameras_of=usual) if robot else None
    base = RunConfig(
        robot=usual,
        human_planner=HumanPlannerConfig(absent=ABSENT, absent_first=-(-ABSENT_FIRST // scene_count)),
        driver=DriverConfig(disturbed=DISTURBED, camera_hz=_pictures_hz(own or usual, spacing_s)),
        renderer=RendererConfig(detail="lod", labels=False),
    )
    return load_run_config(config, own, base=base, keys=keys)


def learn_configs(
    config: Path | None,
    robot: Path | None,
    inputs: str,
    cameras: str,
    goal: GoalName | None = None,
    *,
    scene_count: int = 1,
    perception: Path | None = None,
    keys: Keys = NO_KEYS,
) -> tuple[RunConfig, LearnConfig]:
    """The settings of the recording runs and of training; all inputs of the policy are recorded.

    Args:
        config: TOML file with sections of settings.
        robot: The robot's file.
        inputs: Images that the policy uses, separated by commas; as in the section `[learn]` if empty.
        cameras: Cameras that the policy uses, separated by commas; as in the section `[learn]` if empty.
        goal: Goal input of the policy; as in `[learn]` by default.
        scene_count: Number of scenes that share the first episodes.
        perception: As for `learn_settings`.
        keys: Keys of the command line, by section.

    Raises:
        ConfigError: If a file cannot be read or holds an unknown key or a wrong value, there is no such image, or
            perception does not see the policy's images.
        PolicyError: If perception cannot be used.
    """
    of_runs = {name: section for name, section in keys.items() if name != "learn"}
    runs = learn_settings(config, robot, scene_count=scene_count, perception=perception, keys=of_runs)
    learn = load_learn_config(config)
    given: dict[str, Any] = {"goal": goal} if goal else {}
    if inputs or cameras:
        given["images"] = list(chosen_images(inputs, cameras, runs.robot))
    learn = with_keys(learn, given | dict(keys.get("learn", {})), "learn.")
    try:
        check_cameras(learn.images, runs.robot)
    except ValueError as error:
        raise ConfigError(f"learn: {error}") from error
    if perception is not None:
        _check_perception(perception, runs.robot, learn)
    outputs = tuple(dict.fromkeys((*runs.renderer.outputs, *map(kind_of, learn.images))))
    goal_image = runs.renderer.goal_image or learn.goal != "point"
    renderer = dataclasses.replace(runs.renderer, outputs=outputs, goal_image=goal_image)
    return dataclasses.replace(runs, renderer=renderer), learn


def _check_perception(perception: Path, robot: RobotConfig, learn: LearnConfig) -> None:
    """Raise ConfigError or PolicyError unless trained perception is whole and sees what the policy sees."""
    if (learn.images, learn.goal) != ((RGB,), "point"):
        raise ConfigError('--perception goes with the rgb of one camera and goal "point".')
    with torch_needed():
        from readygo.services.trainer import perception_weights
    spacing_s = load_perception_spec(perception).spacing_s
    perception_weights(perception, robot, with_overrides(RECIPES["pretrained"](), frame_spacing_s=spacing_s))


def _pictures_hz(robot: RobotConfig, spacing_s: float) -> float:
    """Lowest image rate that the camera, the policy's frame stack and the latency allow [Hz]."""
    clock, camera_hz = robot.clock, robot.camera_hz
    late_steps, spacing = clock.steps(robot.camera.latency_s), round(spacing_s * camera_hz)
    if late_steps % clock.image_every:
        return camera_hz
    most = max(1, math.floor(IMAGE_EVERY_S * camera_hz))
    count = max(count for count in range(1, most + 1) if spacing % count == 0)
    return camera_hz / math.gcd(count, late_steps // clock.image_every)


def make_plan(
    scenes: tuple[str, ...],
    out: Path,
    config: RunConfig,
    learn: LearnConfig,
    budget: Budget,
    *,
    avatars: Path | None,
    seed: int,
    people: Path | None = None,
    teacher: Path | None = None,
    perception: Path | None = None,
) -> LearnPlan:
    """Plan the runs of some scenes, with one robot and one scenario mix; writes nothing.

    Args:
        scenes: Scenes, each once.
        out: Folder of the learning run.
        config: Settings of the recording runs.
        learn: Settings of training.
        budget: When it ends.
        avatars: Avatar file or folder; None for the embedded ones. Some are kept for the test, see
            `learned_and_tested`.
        seed: Seed of the recording runs.
        people: Varied avatars that walk in the data; by default those of `avatars` that are not kept for the test.
        teacher: As for `with_teacher`; None for what `LearnConfig.teacher` says, or the expert.
        perception: Folder of trained perception whose network is the encoder; None for one that learns with the policy.

    Raises:
        SceneError: If there is no such scene, or it has no room for humans.
        AvatarError: If there is no avatar.
        ConfigError: If a teacher is given and `learn` names one as well, or people cannot be tracked for the expert.
        PolicyError: If the teacher cannot be used, or was trained for another robot.
        RunError: If `out` holds something else, or was begun with other scenes or settings.
    """
    if not 0 < budget.minutes < math.inf:
        raise RunError(f"--minutes must be above 0, got {budget.minutes:g}.")
    if budget.samples is not None and budget.samples < 1:
        raise RunError(f"--samples must be at least 1, got {budget.samples}.")
    if teacher is not None and learn.teacher != "rl":
        raise ConfigError(f'--teacher is {teacher}, and learn.teacher is "{learn.teacher}": leave one of them out.')
    if learn.teacher == TeacherKind.EXPERT_TRACKED.value:
        teacher = Path(learn.teacher)
    learned, tested = learned_and_tested(avatars)
    places: list[LearnPlace] = []
    for scene, opened in zip(scenes, open_scenes(scenes), strict=True):
        spec = make_spec(opened, people or learned, config, seed=seed, split=Split.TRAIN, static=False)
        name = free_name(spec.metadata["scene"]["name"] or "scene", [place.name for place in places])
        folder = RunFolder(out / "data" / name)
        spec = with_offers(spec, config, learn.mix)
        if teacher is not None:
            spec = with_teacher(spec, config, teacher)
        places.append(LearnPlace(name=name, scene=scene, spec=spec, folder=folder))
    plan = LearnPlan(
        out=out,
        places=tuple(places),
        config=config,
        learn=learn,
        budget=budget,
        avatars=learned,
        tested=tested,
        seed=seed,
        perception=perception,
    )
    _check_folder(plan)
    for place in plan.places:
        place.folder.check(place.spec)
        _check_room(place)
    return plan


@contextmanager
def lock_folder(out: Path) -> Iterator[int]:
    """Lock a run's folder, which is made if missing; the lock ends with the processes that have its descriptor.

    Raises:
        RunError: If another process holds the lock, or the folder cannot be written.
    """
    with held(out / LOCK_FILE) as lock:
        if lock is None:
            raise RunError(f"Another process is learning in {out}; wait for it or stop it.")
        yield lock


def read_state(plan: LearnPlan) -> dict[str, Any]:
    """The state from `write_state`; empty for a new run.

    Raises:
        RunError: If the file is broken.
    """
    return state_of(plan.state_file, FORMAT)


def state_of(path: Path, tag: str) -> dict[str, Any]:
    """What a file has of a run that resumes; empty without a file.

    Args:
        path: The file.
        tag: Its format.

    Raises:
        RunError: If the file is broken, or of another format.
    """
    if not path.exists():
        return {}
    try:
        state = read_json(path)
        if state["format"] != tag:
            raise ValueError(f"format {state['format']!r}")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path} cannot be read: {cause(error)}; choose another --out.") from error
    return dict(state)


def write_state(plan: LearnPlan, **state: Any) -> None:
    """Write the run's settings and its progress."""
    mapping = {"format": FORMAT, "runs": _runs(plan), **_encoder(plan), **state}
    write_json(plan.state_file, mapping, raises=RunError)


def _runs(plan: LearnPlan) -> dict[str, str]:
    return {place.name: place.spec.run for place in plan.places}


def _encoder(plan: LearnPlan) -> dict[str, str]:
    """Hash of the weights that a pretrained encoder begins with."""
    return {"perception": file_ref(plan.perception, WEIGHTS_FILE).sha256} if plan.perception else {}


def _check_folder(plan: LearnPlan) -> None:
    if plan.state_file.exists():
        state = read_state(plan)
        if state.get("perception") != _encoder(plan).get("perception"):
            raise RunError(f"{plan.out} was begun with other perception, or with none; choose another --out.")
        theirs, ours = state["runs"], _runs(plan)
        if set(theirs) != set(ours):
            raise RunError(f"{plan.out} learns in {', '.join(theirs)}; choose another --out for other scenes.")
    else:
        check_new_folder(plan.out)


def check_new_folder(out: Path) -> None:
    """Raise RunError if a folder for a new run of a policy holds something else."""
    check_new(out, LOCK_FILE, FIRST_FOLDER)


def _check_room(place: LearnPlace) -> None:
    """Raise SceneError unless some of the first scenarios have room for humans beside the robot."""
    world = World(place.spec)
    config = dataclasses.replace(world.config.human_planner, absent=0.0, absent_first=0)
    world.config = dataclasses.replace(world.config, human_planner=config)
    planner, reason = world.human_planner(), ""
    for index in range(DRAWS):
        key = EpisodeKey(seed=place.spec.seed, split=place.spec.split, index=index)
        reply = handle_human_plan(planner, HumanPlanRequest(episode=key))
        if reply.scenario is not None:
            return
        reason = reply.rejected
    raise SceneError(
        f"Scene {place.name} has no room for humans: of {DRAWS} scenarios none can take place ({reason}); look at its "
        "maps with `readygo scene inspect`."
    )


def free_name(name: str, taken: list[str]) -> str:
    """The name, with a number appended if it is taken."""
    numbered = (name if number == 1 else f"{name}-{number}" for number in range(1, len(taken) + 2))
    return next(option for option in numbered if option not in taken)
