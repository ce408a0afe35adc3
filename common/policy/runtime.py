"""Run an exported policy with onnxruntime: one thread, the same numbers whatever the batch."""

import copy
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.camera import SensorConfig
from readygo.common.config import section_differences
from readygo.common.errors import PolicyError
from readygo.common.extras import install_command
from readygo.common.images.names import DEPTH, cameras_of, kinds_of
from readygo.common.messages.checks import check_array
from readygo.common.policy.artifact import (
    ENCODER_FILE,
    HEAD_FILE,
    SPEC_FILE,
    Fusion,
    PolicySpec,
    load_spec,
)
from readygo.common.policy.graph import GRAPH_FILE
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.motion import motion_features
from readygo.common.policy.robots import OF_BODY, RANGED, known_as
from readygo.common.policy.sight import camera_on, channels_by_image, channels_of, graph_input
from readygo.common.policy.traits import traits_of
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import OF_CAMERA

LIMITS = ("v_max_mps", "v_min_mps", "w_max_radps", "a_max_mps2", "alpha_max_radps2", "control_hz", "camera_hz")
"""Of `RobotConfig`: what a policy's commands are within, and how often they and its images come."""


class Policy:
    """An exported policy; `load_policy` makes it.

    Args:
        spec: What it was trained for.
        encoder: onnxruntime's session of the graph from image to latent.
        head: That of the graph from latents, own motion and goal to the command.
    """

    def __init__(self, spec: PolicySpec, encoder: Any, head: Any) -> None:
        self.spec = spec
        """What it was trained for."""
        self._encoder = encoder
        self._channels = channels_by_image(spec.inputs.images, spec.inputs.frames_together)
        self._head = head

    def for_robot(self, robot: RobotConfig) -> "Policy":
        """The policy as it drives one of the robots that it knows; itself if it knows one alone.

        Args:
            robot: What it shall drive.

        Raises:
            PolicyError: If the robot is outside of its ranges, or has other limits.
        """
        check_policy_limits(self.spec, robot)
        if not self.spec.robot.ranges.varies:
            return self
        bound = copy.copy(self)
        bound.spec = dataclasses.replace(self.spec, robot=known_as(self.spec.robot, robot, RANGED))
        return bound

    def start(self, robot: RobotConfig | None = None) -> PolicyMemory:
        """Memory for a new episode.

        Args:
            robot: What is driven, for a policy that knows several robots; its own robot by default.
        """
        clock = self.spec.robot.clock
        late_ns = clock.time_ns(clock.steps(self.spec.robot.camera.latency_s))
        spacing_ns = clock.time_ns(self.spec.frame_spacing_steps)
        memory = PolicyMemory(spacing_ns, late_ns, self.spec.inputs.frame_count, clock)
        memory.traits = traits_of(robot or self.spec.robot).astype(np.float32)
        return memory

    def encode(self, images: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        """Latents of RGB images, shape (B, L).

        Images go through one at a time: the sums of a batch are grouped differently, and an episode's result would
        depend on which other episodes run beside it.

        Args:
            images: What the encoder takes, `PolicyInputs.images` side by side, shape (B, H, W, C); all frames stacked
                with early fusion.

        Raises:
            PolicyError: If the images do not have the size that the policy was trained for.
        """
        inputs = self.spec.inputs
        self._check_images(images, inputs.frames_together)
        latents = np.empty((len(images), inputs.latent_count), np.float32)
        for row in range(len(images)):
            latents[row] = self._encoder.run(None, self._fed(images[row : row + 1]))[0][0]
        return latents

    def _check_images(self, images: npt.NDArray[np.uint8], frame_count: int) -> None:
        names, camera = self.spec.inputs.images, self.spec.robot.camera
        check_array("images", images, np.uint8, (None, None, None, None))
        if images.shape[3] != (channels := channels_of(names) * frame_count):
            raise PolicyError(f"The policy sees {', '.join(names)}: {channels} channels, got {images.shape[3]}.")
        if images.shape[1:3] != (camera.height_px, camera.width_px):
            raise PolicyError(
                f"The policy sees images of {camera.height_px}x{camera.width_px} px, got "
                f"{images.shape[1]}x{images.shape[2]}; use the robot.toml that it was trained with."
            )

    def _fed(self, images: npt.NDArray[np.uint8]) -> dict[str, npt.NDArray[np.uint8]]:
        """Images by the names of the encoder's inputs."""
        if len(self._channels) == 1:
            return {"image": images}
        return {graph_input(name): images[..., where] for name, where in self._channels.items()}

    def act(
        self,
        latents: npt.NDArray[np.float32],
        motion: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
        traits: npt.NDArray[np.float32] | None = None,
    ) -> npt.NDArray[np.float32]:
        """Actions of several episodes.

        Args:
            latents: One row per episode, with late fusion those of all frames, shape (B, `latents_width`).
            motion: Features of own motion, see `MotionInput`, shape (B, M).
            goals_xy_m: Goals in the robots' frames (x forward, y left) [m], shape (B, 2).
            traits: Of the robots, for a policy that knows several, shape (B, TRAIT_COUNT); its own robot's by default.

        Returns:
            Commands v [m/s], w [rad/s] within the robot's limits, shape (B, 2).
        """
        features = np.concatenate([latents, motion, goals_xy_m], axis=1).astype(np.float32)
        return self._answer(features, [self.start().traits] * len(features) if traits is None else list(traits))

    def _answer(
        self, features: npt.NDArray[np.float32], traits: Sequence[npt.NDArray[np.float32]]
    ) -> npt.NDArray[np.float32]:
        check_array("features", features, np.float32, (None, self.spec.inputs.feature_count))
        fed = [{"features": row[None]} for row in features]
        if self.spec.inputs.robot:
            fed = [given | {"robot": told[None]} for given, told in zip(fed, traits, strict=True)]
        rows = [self._head.run(None, given)[0] for given in fed]
        return np.concatenate(rows) if rows else np.empty((0, 2), np.float32)

    def step(
        self,
        memories: Sequence[PolicyMemory],
        images: npt.NDArray[np.uint8],
        previous_actions: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """One control step of several episodes: encode, remember, act.

        Args:
            memories: What `start` returned, one per episode.
            images: What the robots see, as `PolicyInputs.images` names it, shape (B, H, W, C).
            previous_actions: Commands executed over the last step: v [m/s], w [rad/s], shape (B, 2).
            goals_xy_m: Goals in the robots' frames (x forward, y left) [m], shape (B, 2).

        Returns:
            Commands v [m/s], w [rad/s] within the robot's limits, shape (B, 2).

        Raises:
            PolicyError: If the images do not have the size that the policy was trained for.
        """
        for memory, command in zip(memories, previous_actions, strict=True):
            memory.advance(command)
        self.see(memories, images)
        return self.decide(memories, previous_actions, goals_xy_m)

    def see(
        self, memories: Sequence[PolicyMemory], images: npt.NDArray[np.uint8], times_ns: Sequence[int | None] = ()
    ) -> None:
        """Have each robot remember an image.

        Args:
            memories: What `start` returned, B of them.
            images: What the robots see, as `PolicyInputs.images` names it, shape (B, H, W, C).
            times_ns: When the images were taken [ns]; see `PolicyMemory.see`.

        Raises:
            PolicyError: If the images do not have the size that the policy was trained for.
        """
        seen = self._kept_of(images)
        for memory, one, time_ns in zip(memories, seen, times_ns or [None] * len(memories), strict=True):
            memory.see(one, time_ns)

    def _kept_of(self, images: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """What is remembered of images."""
        return images if self.spec.inputs.fusion is Fusion.EARLY else self.encode(images)

    def decide(
        self,
        memories: Sequence[PolicyMemory],
        commands: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """Commands v [m/s], w [rad/s] within the robot's limits, by what is remembered, shape (B, 2).

        Args:
            memories: Each with an image and a pose.
            commands: Executed last: v [m/s], w [rad/s], shape (B, 2).
            goals_xy_m: Goals in the robots' frames (x forward, y left) [m], shape (B, 2).
        """
        return self._answer(self.features(memories, commands, goals_xy_m), [memory.traits for memory in memories])

    def features(
        self,
        memories: Sequence[PolicyMemory],
        commands: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """What the head is given to `decide`: latents, own motion and goal in SI units, shape (B, `feature_count`).

        Args:
            memories: As for `decide`.
            commands: As for `decide`, shape (B, 2).
            goals_xy_m: As for `decide`, shape (B, 2).
        """
        own = [memory.own_motion(command) for memory, command in zip(memories, commands, strict=True)]
        motion = motion_features(self.spec.inputs.motion, np.stack(own))
        if self.spec.inputs.fusion is Fusion.EARLY:
            latents = self.encode(np.stack([np.concatenate(memory.window(), axis=2) for memory in memories]))
        else:
            latents = np.stack([np.concatenate(memory.window()) for memory in memories])
        features: npt.NDArray[np.float32] = np.concatenate([latents, motion, goals_xy_m], axis=1).astype(np.float32)
        return features


def load_policy(folder: str | Path, *, robot: RobotConfig | None = None) -> Policy:
    """Load an exported policy.

    Args:
        folder: The folder that training wrote.
        robot: The robot that it shall drive, one of those that it knows if it knows several; None skips the
            comparison.

    Raises:
        PolicyError: If a file is missing or broken, the format is another version's, the camera differs from
            `robot`'s, or onnxruntime is not installed.
    """
    folder = Path(folder)
    spec = load_spec(folder)
    if robot is not None:
        check_policy_camera(spec, robot)
    policy = _made(spec, folder)
    _check_graphs(policy, folder)
    return policy.for_robot(robot) if robot is not None and spec.robot.ranges.varies else policy


def _made(spec: PolicySpec, folder: Path) -> Policy:
    if spec.graph is None:
        return Policy(spec, _open_session(folder / ENCODER_FILE), _open_session(folder / HEAD_FILE))
    from readygo.common.policy.graph_policy import GraphPolicy

    return GraphPolicy(spec, _open_session(folder / GRAPH_FILE))


def check_policy_camera(spec: PolicySpec, robot: RobotConfig, sensor: SensorConfig | None = None) -> None:
    """Raise PolicyError unless the robot has the cameras that the policy was trained with, or one of its ranges.

    Args:
        spec: Of the policy.
        robot: Whose cameras shall look.
        sensor: What shall vary of them; None leaves that out.
    """
    known = known_as(spec.robot, robot, OF_CAMERA)
    found: list[tuple[str, str, Any, Any]] = []
    for name in cameras_of(spec.inputs.images):
        if name and name not in robot.cameras:
            raise PolicyError(
                f"The policy sees with the camera {name!r}, which the robot has not; it has "
                f"{', '.join(robot.all_cameras)}. Leave the robot's cameras out, or name this one in robot.toml."
            )
        differences = section_differences(camera_on(known, name), camera_on(robot, name))
        seen = DEPTH in kinds_of(name, spec.inputs.images)
        found += [(f"{name}." if name else "", *row) for row in differences if seen or not row[0].startswith("depth_")]
    if sensor is not None:
        found += [("sensor.", *row) for row in section_differences(spec.sensor, sensor)]
    if found:
        fields = ", ".join(
            f"{where}{name} {_plain(ours)} (the robot's: {_plain(theirs)})" for where, name, ours, theirs in found
        )
        raise PolicyError(
            f"The policy was trained with another camera: {fields}; leave the robot's camera out, or measure it with "
            "that one by `readygo evaluate --camera robot` if the image size is the same."
        )


def check_policy_limits(spec: PolicySpec, robot: RobotConfig) -> None:
    """Raise PolicyError unless the robot has the limits and rates that the policy's commands were learned for."""
    known = known_as(spec.robot, robot, OF_BODY)
    found = [
        f"{name} {getattr(known, name):g} (the robot's: {getattr(robot, name):g})"
        for name in LIMITS
        if getattr(known, name) != getattr(robot, name)
    ]
    if found:
        raise PolicyError(
            f"The policy was trained for a robot of other limits or rates: {', '.join(found)}; leave them out, the "
            "policy says its own."
        )


def _plain(value: Any) -> str:
    return "none" if value is None or value == [] else f"{value:g}" if isinstance(value, float) else str(value)


def _open_session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise PolicyError(f"onnxruntime is not installed; run: {install_command('policy')}") from error
    if not path.is_file():
        raise PolicyError(f"Policy file {path} is missing; export the policy again.")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises a dozen unrelated types for a broken file
        reason = str(error).splitlines()[0]
        raise PolicyError(f"Policy file {path} cannot be loaded: {reason}; export the policy again.") from error


def _check_graphs(policy: Policy, folder: Path) -> None:
    camera, zeros = policy.spec.robot.camera, np.zeros((1, 2), np.float32)
    shape = (1, camera.height_px, camera.width_px, channels_of(policy.spec.inputs.images))
    memory = policy.start()
    memory.kept.goal_image = np.zeros((*shape[1:3], 3), np.uint8)
    try:
        policy.step([memory], np.zeros(shape, np.uint8), zeros, zeros)
    except PolicyError:
        raise
    except Exception as error:  # as above: a graph of other inputs or shapes
        reason = str(error).splitlines()[0]
        raise PolicyError(f"The graphs of {folder} do not fit its {SPEC_FILE}: {reason}.") from error
