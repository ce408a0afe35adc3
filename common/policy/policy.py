"""A trained policy: what it remembers of an episode, and what it decides; which robots it can drive."""

import abc
import copy
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.camera import SensorConfig
from readygo.common.config import section_differences
from readygo.common.errors import PolicyError
from readygo.common.images.names import DEPTH, cameras_of, kinds_of
from readygo.common.messages.checks import check_array
from readygo.common.policy.artifact import PolicySpec
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.robots import OF_BODY, RANGED, known_as
from readygo.common.policy.sight import camera_on, channels_of
from readygo.common.policy.traits import traits_of
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import OF_CAMERA

LIMITS = ("v_max_mps", "v_min_mps", "w_max_radps", "a_max_mps2", "alpha_max_radps2", "control_hz", "camera_hz")
"""Fields of `RobotConfig` that limit a policy's commands, and set the rates of commands and images."""


class Policy(abc.ABC):
    """A trained policy; `load_policy` makes it.

    In an episode its memory is told of every step (`PolicyMemory.advance`) and sees every image that arrives (`see`).
    `decide` may be called at any time. The numbers do not depend on the batch.
    """

    def __init__(self, spec: PolicySpec) -> None:
        """Keep the spec.

        Args:
            spec: What it was trained for.
        """
        self.spec = spec
        """Robot, camera and inputs that the policy was trained for."""

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
        memory = PolicyMemory(spacing_ns, late_ns, self.spec.graph.frame_count, clock)
        memory.traits = traits_of(robot or self.spec.robot).astype(np.float32)
        return memory

    def step(
        self,
        memories: Sequence[PolicyMemory],
        images: UInt8Array,
        previous_actions: Float32Array,
        goals_xy_m: Float32Array,
    ) -> Float32Array:
        """One control step of several episodes: see, then decide.

        Args:
            memories: What `start` returned, one per episode.
            images: What the robots see, as `PolicySpec.images` names it, shape (B, H, W, C).
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

    def see(self, memories: Sequence[PolicyMemory], images: UInt8Array, times_ns: Sequence[int | None] = ()) -> None:
        """Have each robot remember an image.

        Args:
            memories: What `start` returned, B of them.
            images: What the robots see, as `PolicySpec.images` names it, shape (B, H, W, C).
            times_ns: When the images were taken [ns]; see `PolicyMemory.see`.

        Raises:
            PolicyError: If the images do not have the size that the policy was trained for.
        """
        self._check_images(images)
        for memory, image, time_ns in zip(memories, images, times_ns or [None] * len(memories), strict=True):
            memory.see(image, time_ns)

    @abc.abstractmethod
    def decide(
        self,
        memories: Sequence[PolicyMemory],
        commands: Float32Array,
        goals_xy_m: Float32Array,
    ) -> Float32Array:
        """Commands v [m/s], w [rad/s] within the robot's limits, by what is remembered, shape (B, 2).

        Args:
            memories: Each with an image and a pose.
            commands: Executed last: v [m/s], w [rad/s], shape (B, 2).
            goals_xy_m: Goals in the robots' frames (x forward, y left) [m], shape (B, 2).
        """

    def _check_images(self, images: UInt8Array) -> None:
        names, camera = self.spec.images, self.spec.robot.camera
        check_array("images", images, np.uint8, (None, None, None, None))
        if images.shape[3] != (channels := channels_of(names)):
            raise PolicyError(f"The policy sees {', '.join(names)}: {channels} channels, got {images.shape[3]}.")
        if images.shape[1:3] != (camera.height_px, camera.width_px):
            raise PolicyError(
                f"The policy sees images of {camera.height_px}x{camera.width_px} px, got "
                f"{images.shape[1]}x{images.shape[2]}; use the robot.toml that it was trained with."
            )


def check_policy_camera(spec: PolicySpec, robot: RobotConfig, sensor: SensorConfig | None = None) -> None:
    """Raise PolicyError unless the robot has the cameras that the policy was trained with, or one of its ranges.

    Args:
        spec: What the policy was trained for.
        robot: Whose cameras shall look.
        sensor: What shall vary of them; None leaves that out.
    """
    known = known_as(spec.robot, robot, OF_CAMERA)
    found: list[tuple[str, str, Any, Any]] = []
    for name in cameras_of(spec.images):
        if name and name not in robot.cameras:
            raise PolicyError(
                f"The policy sees with the camera {name!r}, which the robot has not; it has "
                f"{', '.join(robot.all_cameras)}. Leave the robot's cameras out, or name this one in robot.toml."
            )
        differences = section_differences(camera_on(known, name), camera_on(robot, name))
        seen = DEPTH in kinds_of(name, spec.images)
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
