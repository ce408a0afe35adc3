"""Episodes as training holds them: encoded images and numbers."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, FloatingArray, UInt8Array
from readygo.common.camera.view import FieldOfView, in_view, view_of
from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from readygo.common.images.names import GOAL_IMAGE
from readygo.common.messages import CommittedEpisode, Sample
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import UNKNOWN_RISK

BODY_RADIUS_M = 0.25
"""A human whose disc of this radius reaches into the view is in it [m]."""

Eyes = Sequence[tuple[tuple[float, float, float], FieldOfView]]
"""Cameras of a robot: x, y [m] and yaw [rad] in its frame, and the view."""


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class TrainingEpisode:
    """One recorded episode of T samples."""

    name: str
    """Tells it from all others."""
    images: tuple[bytes, ...]
    """Encoded images, T of them; empty where none was taken."""
    actions: Float32Array
    """Commands executed after each sample: v [m/s], w [rad/s], shape (T, 2)."""
    goals_xy_m: Float32Array
    """Goals in the robot's frame [m], shape (T, 2)."""
    xyyaw: Float64Array
    """Robot's poses: x, y [m], yaw [rad], shape (T, 3)."""
    expert: Float32Array | None = None
    """What the expert would have executed from each sample on: v [m/s], w [rad/s], shape (T, K, 2), NaN where there is
    no image; None if the expert was not asked."""
    risks: UInt8Array | None = None
    """What each command of `readygo.common.robot.command_grid` would have led to, see `Dataset.risks`, shape (T, C);
    None if the data do not say."""
    humans: Float32Array | None = None
    """The nearest visible human: 1 if there is one, else 0; bearing to the left [rad], distance [m]; shape (T, 3).
    None if the data do not say."""
    driver: DriverKind = DriverKind.EXPERT
    outcome: Outcome = Outcome.SUCCESS
    static: bool = True
    """True if there were no humans."""
    policy: str = ""
    """SHA-256 of the policy that drove; empty for the expert."""
    outputs: Mapping[str, tuple[bytes, ...]] = field(default_factory=dict)
    """Files of further images by name (`readygo.common.images.names`), T of each; empty where there is none. An image
    of the goal is at the first sample."""
    drawn: Mapping[str, float] = field(default_factory=dict)
    """What its robot drew from the robot's ranges, see `EpisodeHeader.drawn`."""

    @property
    def sample_count(self) -> int:
        """Number of samples T."""
        return len(self.images)

    @property
    def pictured(self) -> BoolArray:
        """True where an image was taken, shape (T,)."""
        return np.array([bool(image) for image in self.images], np.bool_)

    @property
    def size_bytes(self) -> int:
        """Memory that it takes, roughly."""
        numbers = (self.actions, self.goals_xy_m, self.xyyaw, self.expert, self.risks, self.humans)
        files = (self.images, *self.outputs.values())
        return sum(len(file) for name in files for file in name) + sum(
            array.nbytes for array in numbers if array is not None
        )


def read_episodes(
    source: Dataset, *, with_humans: bool = False, outputs: Sequence[str] = ()
) -> Iterator[TrainingEpisode]:
    """The episodes of recorded shards, in their order.

    Args:
        source: The shards.
        with_humans: Read where the humans were as well, which takes a while.
        outputs: Names of further images to read.

    Raises:
        DatasetError: If a shard is damaged, has no such images, or does not tell which robot saw the humans.
    """
    robot = robot_of_source(source) if with_humans else RobotConfig()
    commands = None
    if source.has_expert:
        commands = np.concatenate([source.expert_actions[:, None], source.expert_ahead], axis=1)
    risks = source.risks if source.has_risks else None
    distances_m, xyyaw = source.truth["human_distance_m"], source.poses[:, [0, 1, 3]]
    visible = source.truth["human_visible"]
    for number, entry in enumerate(source.episodes):
        rows = range(entry.first_sample, entry.first_sample + entry.sample_count)
        part = slice(rows.start, rows.stop)
        humans = None
        if with_humans:
            places = [poses[:, :2] for poses in source.humans_xyzyaw[part]]
            humans = nearest_humans(xyyaw[part], places, visible[part], robot.with_values(entry.drawn))
        images = tuple(source.image(row) for row in rows)
        yield TrainingEpisode(
            name=entry.sha256,
            images=images,
            actions=source.actions[part],
            goals_xy_m=source.goals_xy_m[part],
            xyyaw=xyyaw[part],
            expert=None if commands is None else commands[part],
            risks=None if risks is None else risks[part],
            humans=humans,
            driver=entry.driver,
            outcome=entry.outcome,
            static=not bool(np.isfinite(distances_m[part]).any()),
            policy=entry.policy,
            outputs={
                name: (source.goal_image(number), *[b""] * (len(rows) - 1))
                if name == GOAL_IMAGE
                else tuple(source.output(row, name) if image else b"" for row, image in zip(rows, images, strict=True))
                for name in outputs
            },
            drawn=entry.drawn,
        )


def robot_of_source(source: Dataset) -> RobotConfig:
    """The robot that the samples were recorded with.

    Raises:
        DatasetError: If the data do not tell.
    """
    if source.robot is None:
        raise DatasetError("The data do not tell which robot recorded them; record them again.")
    return source.robot


def committed_episode(message: CommittedEpisode, robot: RobotConfig, outputs: Sequence[str] = ()) -> TrainingEpisode:
    """An episode as the recorder announces it.

    Args:
        message: The announcement.
        robot: That of the run; the episode has one of its ranges, if it has any.
        outputs: Names of further images to take.

    Raises:
        DatasetError: If it has no such images.
    """
    header, samples = message.header, message.samples
    xyyaw = np.array([(s.robot_xyzyaw[0], s.robot_xyzyaw[1], s.robot_xyzyaw[3]) for s in samples], np.float64)
    places, visible = [_places(s) for s in samples], np.array([s.human_visible for s in samples])
    return TrainingEpisode(
        name=header.episode.episode_id,
        images=tuple(sample.image for sample in samples),
        actions=np.array([(s.action_v_mps, s.action_w_radps) for s in samples], np.float32),
        goals_xy_m=np.array([s.goal_xy_robot_m for s in samples], np.float32),
        xyyaw=xyyaw,
        expert=_expert(samples),
        risks=_risks(samples),
        humans=nearest_humans(xyyaw, places, visible, robot.with_values(header.drawn)),
        driver=header.driver,
        outcome=header.outcome,
        static=not header.avatars,
        policy=header.policy,
        outputs={name: tuple(_output(sample, name) for sample in samples) for name in outputs},
        drawn=header.drawn,
    )


def _output(sample: Sample, name: str) -> bytes:
    wanted = sample.seq == 0 if name == GOAL_IMAGE else sample.image
    if wanted and name not in sample.outputs:
        raise DatasetError(
            f"The samples have no {name!r} images, which the policy shall see; record them, see "
            "`readygo generate --outputs` and goal_image under [renderer]."
        )
    return sample.outputs.get(name, b"")


def nearest_humans(
    xyyaw: Float64Array, places_xy_m: Sequence[FloatingArray], visible: BoolArray, robot: RobotConfig
) -> Float32Array:
    """`TrainingEpisode.humans`: the nearest human in view of a camera, at the samples at which one is visible.

    Whether something hides one of them is not known here.

    Args:
        xyyaw: Robot's poses, shape (T, 3).
        places_xy_m: Where the humans are at each sample [m], shapes (H, 2).
        visible: True where one is in view, shape (T,).
        robot: Whose cameras look.
    """
    found, eyes = np.zeros((len(xyyaw), 3), np.float32), eyes_of(robot)
    for row in itertools.compress(range(len(xyyaw)), visible):
        dx, dy = (np.asarray(places_xy_m[row], np.float64).reshape(-1, 2) - xyyaw[row, :2]).T
        bearings_rad = np.remainder(np.arctan2(dy, dx) - xyyaw[row, 2] + np.pi, 2 * np.pi) - np.pi
        distances_m = np.hypot(dx, dy)
        for nearest in np.argsort(distances_m).tolist():
            if eyes_show(eyes, float(bearings_rad[nearest]), float(distances_m[nearest])):
                found[row] = 1.0, bearings_rad[nearest], distances_m[nearest]
                break
    return found


def eyes_of(robot: RobotConfig) -> Eyes:
    """Where the cameras of a robot are in its frame, and what they show."""
    return [(camera.eye(0.0, 0.0, 0.0), view_of(camera)) for camera in robot.all_cameras.values()]


def eyes_show(eyes: Eyes, bearing_rad: float, distance_m: float) -> bool:
    """True if some part of a human lies in the view of a camera, hidden or not.

    Args:
        eyes: The robot's cameras.
        bearing_rad: Where the human is, from the robot's heading to the left [rad].
        distance_m: How far it is from the robot's centre [m].
    """
    x_m, y_m = distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad)
    return any(in_view(eye, x_m, y_m, view, math.inf, BODY_RADIUS_M) for eye, view in eyes)


def _expert(samples: Sequence[Sample]) -> Float32Array | None:
    asked = [row for row, sample in enumerate(samples) if sample.image]
    if not all(samples[row].expert_commands for row in asked):
        return None
    expert = np.full((len(samples), len(samples[0].expert_commands), 2), np.nan, np.float32)
    expert[asked] = [samples[row].expert_commands for row in asked]
    return expert


def _risks(samples: Sequence[Sample]) -> UInt8Array | None:
    asked = [row for row, sample in enumerate(samples) if sample.image]
    count = len(samples[asked[0]].risks)
    if count == 0 or any(len(samples[row].risks) != count for row in asked):
        return None
    risks = np.full((len(samples), count), UNKNOWN_RISK, np.uint8)
    risks[asked] = [np.frombuffer(samples[row].risks, np.uint8) for row in asked]
    return risks


def _places(sample: Sample) -> Float64Array:
    return np.array([place[:2] for place in sample.humans_xyzyaw], np.float64).reshape(-1, 2)
