"""What must hold in one recorded episode."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from readygo.common.dataset import schemas
from readygo.common.dataset.canonical import canonical_sha256, is_canonical
from readygo.common.dataset.chunk import parse
from readygo.common.dataset.label_checks import wrong_labels
from readygo.common.dataset.poses import pose_xyzyaw
from readygo.common.dataset.records import ChunkSpan, Message, iter_messages
from readygo.common.errors import DatasetError
from readygo.common.frames import goal_in_robot_frame
from readygo.common.images.encoded import decode_image
from readygo.common.images.files import FILE_FORMAT, decode_output
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, kind_of
from readygo.common.messages.episode import EpisodeKey
from readygo.common.robot import Clock, RobotConfig
from readygo.common.robot.kinematics import limit_command, step_unicycle

LIMIT_TOLERANCE = 1e-6
"""Slack on speeds [m/s, rad/s]: limits are applied in float64."""
POSITION_TOLERANCE_M = 1e-5
YAW_TOLERANCE_RAD = 1e-6

Finding = tuple[str, str]
"""Kind and text of a defect."""


@dataclass(frozen=True)
class ActionLimits:
    """The robot that an episode's actions are held against; None leaves them unchecked."""

    robot: RobotConfig | None


@dataclass(frozen=True, slots=True)
class _Step:
    """One sample, decoded."""

    pose: tuple[float, float, float, float]
    v_mps: float
    w_radps: float
    goal_xy_m: tuple[float, float]
    image: bytes | None
    """Encoded image; None at a sample without an image."""
    image_format: str


class EpisodeChecks:
    """Checks the episode in one chunk; `outputs` are the images besides rgb and the labels that its shard has."""

    def __init__(self, view: memoryview, span: ChunkSpan, limits: ActionLimits, outputs: Sequence[str] = ()) -> None:
        self.episode: EpisodeKey | None = None
        self.sample_count = 0
        self._image_every = 1
        self._view = view
        self._span = span
        self._robot = limits.robot
        self._clock = limits.robot.clock if limits.robot is not None else Clock()
        self._outputs = schemas.output_channels(outputs)
        self._sample_channels = (*schemas.SAMPLE_CHANNELS, *self._outputs.values())
        self._calibration = schemas.CALIBRATION
        self._all: list[Message] = []
        self._by_channel: dict[int, list[Message]] = {
            channel.number: []
            for channel in {*schemas.channels_with(self._outputs), *schemas.staged_channels(self._outputs)}
        }
        self._name = f"the episode at byte {span.body}"

    def run(self) -> Iterator[Finding]:
        """Everything that does not hold."""
        try:
            yield from self._frame()
            start, calibration, commit = (
                self._parse_at(channel, 0)
                for channel in (schemas.EPISODE_START, self._calibration, schemas.EPISODE_COMMIT)
            )
            self.episode = schemas.episode_key(start)
            self._name = f"episode {self.episode.episode_id}"
            self.sample_count = len(self._messages(schemas.ROBOT_POSE))
            taken = [message.sequence for message in self._messages(schemas.IMAGE)]
            expert = self._outputs.get(schemas.EXPERT)
            asked = self._parse_at(expert, 0) if expert is not None and self._messages(expert) else None
            self._image_every = schemas.image_every(asked, taken, self.sample_count)
            if self._image_every % self._clock.image_every:
                yield "time", f"{self._name}: it has more images than the robot's camera takes"
            drawn = self._outputs.get(schemas.DRAWN)
            if self._robot is not None and drawn is not None and self._messages(drawn):
                self._robot = self._robot.with_values(schemas.drawn_of(self._parse_at(drawn, 0)))
            yield from self._hash(start, commit)
            broken = list(self._sequence(start, commit))
            yield from broken
            yield from self._times()
            if not broken:
                yield from self._content(start, calibration)
                sizes = {"": (calibration.height, calibration.width), **self._further_sizes()}
                yield from self._output_images(start, sizes)
                yield from self._labels()
                yield from self._expert_commands()
                yield from self._frames()
        except DatasetError as error:
            yield "sequence", f"{self._name}: {error}"

    def _messages(self, channel: schemas.Channel) -> list[Message]:
        return self._by_channel[channel.number]

    def _samples_with(self, channel: schemas.Channel) -> range:
        return schemas.samples_with(channel, self.sample_count, self._image_every)

    def _parse_at(self, channel: schemas.Channel, position: int) -> Any:
        """The message of a channel, by its position there: what is not at every sample has fewer than samples."""
        message = self._messages(channel)[position]
        return parse(channel, self._view[message.body : message.end])

    def _frame(self) -> Iterator[Finding]:
        """Group the messages; an episode begins with its start and ends with its commit."""
        self._all = list(iter_messages(self._view, self._span.body, self._span.end))
        for message in self._all:
            if message.channel not in self._by_channel:
                raise DatasetError(f"a message is on the unknown channel {message.channel}")
            self._by_channel[message.channel].append(message)
        if not is_canonical(self._all):
            self._calibration = schemas.ROS_CALIBRATION
        for channel in (schemas.EPISODE_START, self._calibration, schemas.EPISODE_COMMIT):
            if len(self._messages(channel)) != 1:
                raise DatasetError(f"there are {len(self._messages(channel))} messages on {channel.topic}, not 1")
        ends = (self._all[0].channel, self._all[-1].channel)
        if ends != (schemas.EPISODE_START.number, schemas.EPISODE_COMMIT.number):
            yield "sequence", f"{self._name} does not begin with its start and end with its commit"

    def _hash(self, start: Any, commit: Any) -> Iterator[Finding]:
        (last,) = self._messages(schemas.EPISODE_COMMIT)
        until_commit = [message for message in self._all if message.offset <= last.offset]
        if canonical_sha256(self._view, until_commit, start.index) != commit.sha256:
            yield "sha256", f"{self._name} does not match the SHA-256 of its commit"

    def _sequence(self, start: Any, commit: Any) -> Iterator[Finding]:
        for channel in self._sample_channels:
            numbers = [message.sequence for message in self._messages(channel)]
            expected = schemas.samples_with(channel, commit.sample_count, self._image_every)
            if numbers != list(expected):
                missing = sorted(set(expected) - set(numbers))
                what = f"lacks samples {_some(missing)}" if missing else "has samples out of order"
                yield "sequence", f"{self._name}: {channel.topic} {what}"
        if not start.sample_count == commit.sample_count > 0:
            yield "sequence", f"{self._name}: start says {start.sample_count} samples, commit {commit.sample_count}"
        if (start.episode_id, start.index) != (commit.episode_id, commit.index):
            yield "sequence", f"{self._name}: its commit is that of {commit.episode_id}"

    def _times(self) -> Iterator[Finding]:
        base_ns = self._messages(schemas.EPISODE_START)[0].log_time_ns
        for channel in self._sample_channels:
            wrong = [
                message.sequence
                for message in self._messages(channel)
                if not message.publish_time_ns == message.log_time_ns == base_ns + self._clock.time_ns(message.sequence)
            ]
            if wrong:
                yield (
                    "time",
                    f"{self._name}: {channel.topic} is not at {self._clock.rate_hz} Hz at samples {_some(wrong)}",
                )
        for channel in (schemas.IMAGE, schemas.ROBOT_POSE, schemas.HUMANS, *self._outputs.values()):
            wrong = [
                message.sequence
                for position, message in enumerate(self._messages(channel))
                if any(
                    time_ns != message.log_time_ns for time_ns in schemas.stamps_ns(self._parse_at(channel, position))
                )
            ]
            if wrong:
                yield "time", f"{self._name}: {channel.topic} has other stamps inside at samples {_some(wrong)}"

    def _content(self, start: Any, calibration: Any) -> Iterator[Finding]:
        steps = [self._step(seq) for seq in range(self.sample_count)]
        goal_xy_m = (start.goal_x_m, start.goal_y_m)
        first = (start.start_x_m, start.start_y_m, 0.0, start.start_yaw_rad)
        if not _near_pose(first, steps[0].pose):
            yield "motion", f"{self._name}: sample 0 is not at the episode's start pose"
        checks: list[tuple[str, str, Callable[[int], bool]]] = [
            (
                "motion",
                "the pose does not follow from the pose and the action before",
                _follows(steps, self._clock.dt_s),
            ),
            ("goal", "the relative goal contradicts the pose and the goal", _points_at(steps, goal_xy_m)),
            ("image", "the image is damaged or has another size or format", self._pictures(steps, start, calibration)),
        ]
        if self._robot is not None:
            checks.append(("action", "the action is beyond the robot's limits", _within_limits(steps, self._robot)))
            checks.append(("action", "the action changes faster than the robot can", _smooth(steps, self._robot)))
        for kind, text, holds in checks:
            wrong = [seq for seq in range(len(steps)) if not holds(seq)]
            if wrong:
                yield kind, f"{self._name}: {text} at samples {_some(wrong)}"

    def _further_sizes(self) -> dict[str, tuple[int, int]]:
        """Height and width of the images of the cameras besides the first one, by name."""
        sizes = {}
        for camera in schemas.camera_channels(schemas.further_cameras(self._outputs)):
            if len(self._messages(camera.calibration)) != 1:
                count = len(self._messages(camera.calibration))
                raise DatasetError(f"there are {count} messages on {camera.calibration.topic}, not 1")
            message = self._parse_at(camera.calibration, 0)
            sizes[camera.name] = message.height, message.width
        return sizes

    def _output_images(self, start: Any, sizes: Mapping[str, tuple[int, int]]) -> Iterator[Finding]:
        """Images besides the first rgb must be whole, and masks must name humans of the episode."""
        for name, channel in self._outputs.items():
            if channel.number not in schemas.IMAGE_NUMBERS:
                continue
            kind, shape = RGB if name == GOAL_IMAGE else kind_of(name), sizes[camera_of(name)]
            image_format = start.image_format if kind == RGB else FILE_FORMAT
            bad, strangers = [], []
            for position, seq in enumerate(self._samples_with(channel)):
                message = self._parse_at(channel, position)
                image = decode_image(message.data) if kind == RGB else decode_output(kind, message.data)
                if image is None or image.shape[:2] != shape or message.format != image_format:
                    bad.append(seq)
                elif kind == "mask" and image.max() > len(start.avatars):
                    strangers.append(seq)
            if bad:
                text = f"the {name} image is damaged or has another size or format at samples {_some(bad)}"
                yield "image", f"{self._name}: {text}"
            if strangers:
                yield "image", f"{self._name}: the mask names humans who are not there at samples {_some(strangers)}"

    def _labels(self) -> Iterator[Finding]:
        """Labels must be there for everybody, and lie where humans are."""
        if not set(schemas.LABEL_CHANNELS) <= set(self._outputs):
            return
        channels = (schemas.HUMANS, *schemas.LABEL_CHANNELS.values())
        found: dict[str, list[int]] = {}
        for seq in range(self.sample_count):
            for text in wrong_labels(*(self._parse_at(channel, seq) for channel in channels)):
                found.setdefault(text, []).append(seq)
        for text, numbers in found.items():
            yield "label", f"{self._name}: {text} at samples {_some(numbers)}"

    def _expert_commands(self) -> Iterator[Finding]:
        """Commands of the expert must be what the robot could have executed."""
        if schemas.EXPERT not in self._outputs:
            return
        wrong, channel = [], self._outputs[schemas.EXPERT]
        first = self._parse_at(channel, 0)
        count, ending = len(first.v_mps), schemas.ending_of(first)
        for position, seq in enumerate(self._samples_with(channel)):
            commands = self._parse_at(channel, position)
            action = self._parse_at(schemas.ACTION, seq - 1) if seq else None
            before = (action.v_mps, action.w_radps) if action is not None else (0.0, 0.0)
            if (schemas.ending_of(commands), commands.image_every or 1) != (ending, self._image_every):
                yield "sequence", f"{self._name}: sample {seq} tells of another end or camera than sample 0"
            if not _can_execute(commands, count, before, self._robot):
                wrong.append(seq)
        if wrong:
            yield "action", f"{self._name}: the robot could not do what the expert would at samples {_some(wrong)}"

    def _frames(self) -> Iterator[Finding]:
        """The robot's frame must be at its pose, at every sample of an episode that is staged for viewers."""
        if self._calibration is schemas.CALIBRATION:
            return
        frames = {message.sequence: place for place, message in enumerate(self._messages(schemas.TRANSFORMS))}
        wrong = []
        for place, message in enumerate(self._messages(schemas.ROBOT_POSE)):
            pose = self._parse_at(schemas.ROBOT_POSE, place)
            frame = self._parse_at(schemas.TRANSFORMS, frames[message.sequence]) if message.sequence in frames else None
            if frame is None or not _holds_pose(frame, pose):
                wrong.append(message.sequence)
        if wrong:
            yield "frame", f"{self._name}: the robot's frame is not at its pose at samples {_some(wrong)}"

    def _step(self, seq: int) -> _Step:
        pose, action, goal = (
            self._parse_at(channel, seq) for channel in (schemas.ROBOT_POSE, schemas.ACTION, schemas.GOAL)
        )
        taken = self._parse_at(schemas.IMAGE, seq // self._image_every) if seq % self._image_every == 0 else None
        return _Step(
            pose_xyzyaw(pose.pose),
            action.v_mps,
            action.w_radps,
            (goal.x_m, goal.y_m),
            taken.data if taken is not None else None,
            taken.format if taken is not None else "",
        )

    def _pictures(self, steps: Sequence[_Step], start: Any, calibration: Any) -> Callable[[int], bool]:
        shape = (calibration.height, calibration.width, 3)

        def holds(seq: int) -> bool:
            data = steps[seq].image
            if data is None:
                return True
            image = decode_image(data)
            return image is not None and image.shape == shape and steps[seq].image_format == start.image_format

        return holds


def _follows(steps: Sequence[_Step], dt_s: float) -> Callable[[int], bool]:
    def holds(seq: int) -> bool:
        if seq == 0:
            return True
        before = steps[seq - 1]
        x, y, _, yaw = before.pose
        x_m, y_m, yaw_rad = step_unicycle(x, y, yaw, before.v_mps, before.w_radps, dt_s)
        return _near_pose((x_m, y_m, 0.0, yaw_rad), steps[seq].pose)

    return holds


def _points_at(steps: Sequence[_Step], goal_xy_m: tuple[float, float]) -> Callable[[int], bool]:
    def holds(seq: int) -> bool:
        x_m, y_m, _, yaw_rad = steps[seq].pose
        here_m = goal_in_robot_frame(x_m, y_m, yaw_rad, goal_xy_m)
        return math.dist(here_m, steps[seq].goal_xy_m) <= POSITION_TOLERANCE_M

    return holds


def _within_limits(steps: Sequence[_Step], robot: RobotConfig) -> Callable[[int], bool]:
    def holds(seq: int) -> bool:
        step = steps[seq]
        v_fits = robot.v_min_mps - LIMIT_TOLERANCE <= step.v_mps <= robot.v_max_mps + LIMIT_TOLERANCE
        return v_fits and abs(step.w_radps) <= robot.w_max_radps + LIMIT_TOLERANCE

    return holds


def _smooth(steps: Sequence[_Step], robot: RobotConfig) -> Callable[[int], bool]:
    def holds(seq: int) -> bool:
        if seq == 0:
            return True
        before, step, dt_s = steps[seq - 1], steps[seq], robot.clock.dt_s
        v_fits = abs(step.v_mps - before.v_mps) <= robot.a_max_mps2 * dt_s + LIMIT_TOLERANCE
        return v_fits and abs(step.w_radps - before.w_radps) <= robot.alpha_max_radps2 * dt_s + LIMIT_TOLERANCE

    return holds


def _can_execute(commands: Any, count: int, before: tuple[float, float], robot: RobotConfig | None) -> bool:
    """True if there are `count` commands, each within reach of the one before it."""
    if not len(commands.v_mps) == len(commands.w_radps) == count > 0:
        return False
    for v, w in zip(commands.v_mps, commands.w_radps, strict=True):
        reached = limit_command(v, w, *before, robot, robot.clock.dt_s) if robot is not None else (v, w)
        if not math.isfinite(v + w) or math.dist((v, w), reached) > LIMIT_TOLERANCE:
            return False
        before = v, w
    return True


def _holds_pose(frames: Any, pose: Any) -> bool:
    """True if the first of a message's frames is that of the robot, at a PoseInFrame and its time."""
    if not frames.transforms:
        return False
    robot = frames.transforms[0]
    return (robot.child_frame_id, robot.timestamp, robot.translation, robot.rotation) == (
        schemas.ROBOT_FRAME,
        pose.timestamp,
        pose.pose.position,
        pose.pose.orientation,
    )


def _near_pose(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    """True if x, y and yaw agree; heights come from the floor."""
    turn_rad = math.remainder(a[3] - b[3], math.tau) if math.isfinite(a[3] - b[3]) else math.inf
    return math.hypot(a[0] - b[0], a[1] - b[1]) <= POSITION_TOLERANCE_M and abs(turn_rad) <= YAW_TOLERANCE_RAD


def _some(numbers: Sequence[int]) -> str:
    """The first few numbers."""
    shown = ", ".join(map(str, numbers[:5]))
    return shown if len(numbers) <= 5 else f"{shown} and {len(numbers) - 5} more"
