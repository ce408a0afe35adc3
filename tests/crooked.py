"""A crooked robot, its episodes and a crooked body: no value is zero, one, symmetric or equal to another one.

Round fixtures hide mistakes: with one camera, 20 Hz, yaw 0 and a success, a sign, a factor or a step more or less gives
the same result. Here commands are held for several steps, there are two unlike cameras, the start is away from the
origin at a yaw of 2.5 rad, and episodes end in a collision.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.avatars import Avatar
from readygo.common.camera import CameraConfig
from readygo.common.config import section_to_mapping
from readygo.common.dataset import Provenance, ShardWriter, encode_episode, shard_name
from readygo.common.images.files import encode_output
from readygo.common.messages import EpisodeHeader, EpisodeKey, FurtherCamera, Sample, Split, sample_crc32
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.robot import RobotConfig, limit_command, step_unicycle
from readygo.common.robot.command_grid import command_grid
from tests.common.dataset.episodes import PROVENANCE, image_number, jpeg, make_images
from tests.services.animator.bodies import make_avatar

CAMERA = CameraConfig(
    height_px=22, width_px=34, fx_px=19.5, fy_px=21.0, cx_px=15.2, cy_px=12.4,
    mount_x_m=0.13, mount_y_m=-0.07, mount_height_m=0.62, mount_yaw_deg=-11.0, mount_pitch_deg=7.0,
)  # fmt: skip
"""The first camera: its principal point is off the middle, it looks to the right and down."""
LEFT = CameraConfig(
    height_px=18, width_px=26, horizontal_fov_deg=77.0,
    mount_x_m=-0.05, mount_y_m=0.21, mount_height_m=0.44, mount_yaw_deg=68.0, mount_pitch_deg=-4.0,
)  # fmt: skip
"""The second camera has another size and looks to the left."""
ROBOT = RobotConfig(
    radius_m=0.31, planning_radius_m=0.39, height_m=1.35, v_max_mps=0.85, v_min_mps=-0.2, w_max_radps=0.95,
    a_max_mps2=0.7, alpha_max_radps2=1.6, control_hz=10, camera_hz=20, camera=CAMERA, camera_name="front",
    cameras={"left": LEFT},
)  # fmt: skip
"""Commanded at 10 Hz, simulated and seen at 20 Hz: a command is held for two steps."""
ODD_RATES = dataclasses.replace(ROBOT, control_hz=10, camera_hz=15)
"""The same robot at 30 steps per second: a command every third step, an image every second one."""
TWINS = dataclasses.replace(
    ROBOT,
    camera=CameraConfig(height_px=22, width_px=34, mount_x_m=0.13, mount_height_m=0.62, mount_pitch_deg=7.0),
    cameras={
        "left": LEFT,
        "right": dataclasses.replace(LEFT, mount_y_m=-LEFT.mount_y_m, mount_yaw_deg=-LEFT.mount_yaw_deg),
    },
)
"""The same robot with cameras that have twins in a mirror."""
START_XYYAW = (-3.2, 7.1, 2.5)
GOAL_XY_M = (-6.3, 8.9)
FLOOR_M = 0.37
"""Height of the floor below the robot [m]."""
HUMANS_XYZYAW = ((-4.6, 8.7, 0.41, -1.9), (-5.2, 7.4, 0.33, 0.7))
"""Where two humans are at first, to the right and to the left of the robot's path."""
HUMANS_MPS = ((-0.35, -0.6), (0.55, 0.25))
"""Their velocities along x and y [m/s]."""
EXPERT_AHEAD = 5
"""Commands of the expert at each image: the next step's and further ones."""


def crooked_provenance(robot: RobotConfig = ROBOT) -> Provenance:
    """Of a run with a crooked robot."""
    return dataclasses.replace(PROVENANCE, config={"robot": section_to_mapping(robot), "episode": {}})


def crooked_header(
    index: int = 3, sample_count: int = 24, *, robot: RobotConfig = ROBOT, **changes: Any
) -> EpisodeHeader:
    """A failed episode that a policy drove."""
    camera = robot.camera
    header = EpisodeHeader(
        episode=EpisodeKey(seed=7, split=Split.TRAIN, index=index),
        sample_count=sample_count,
        goal_xy_m=GOAL_XY_M,
        start_xyyaw=START_XYYAW,
        avatars=("ann", "bob"),
        encounters=("crossing", "oncoming"),
        image_format="jpeg",
        height_px=camera.height_px,
        width_px=camera.width_px,
        K_px=tuple(camera.K_px.ravel().tolist()),
        outcome=Outcome.HUMAN_COLLISION,
        driver=DriverKind.POLICY,
        policy="5a" * 32,
        image_every=robot.clock.image_every,
        cameras=tuple(
            FurtherCamera(
                name=name, height_px=one.height_px, width_px=one.width_px, K_px=tuple(one.K_px.ravel().tolist())
            )
            for name, one in robot.cameras.items()
        ),
    )
    return dataclasses.replace(header, **changes)


def crooked_samples(header: EpisodeHeader, *, robot: RobotConfig = ROBOT) -> tuple[Sample, ...]:
    """What the robot did: every command is held for `control_every` steps, and reached within the robot's limits."""
    clock, samples = robot.clock, []
    x_m, y_m, yaw_rad = header.start_xyyaw
    before = 0.0, 0.0
    for seq in range(header.sample_count):
        command = seq // clock.control_every
        v_mps, w_radps = limit_command(
            0.62 + 0.2 * math.cos(command), 0.8 * math.sin(0.7 * command + 0.4), *before, robot, clock.dt_s
        )
        humans = human_places(seq, robot)
        distance_m = min(math.hypot(x - x_m, y - y_m) for x, y, _, _ in humans)
        dx, dy = header.goal_xy_m[0] - x_m, header.goal_xy_m[1] - y_m
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        seen = seq % clock.image_every == 0
        number = image_number(header.episode.index, seq)
        image = jpeg(number, header.height_px, header.width_px) if seen else b""
        outputs = _further_images(header, number) if seen else {}
        sample = Sample(
            seq=seq,
            crc32=sample_crc32(image, outputs),
            time_ns=clock.time_ns(seq),
            image=image,
            action_v_mps=v_mps,
            action_w_radps=w_radps,
            goal_xy_robot_m=(c * dx + s * dy, c * dy - s * dx),
            robot_xyzyaw=(x_m, y_m, FLOOR_M, yaw_rad),
            humans_xyzyaw=humans,
            human_distance_m=distance_m,
            time_to_collision_s=2.9 - 0.11 * seq,
            human_visible=seq % 3 != 1,
            expert_cost=1.7 + 0.13 * seq,
            replanned=seq % 5 == 2,
            outputs=outputs,
            expert_commands=_expert(before, seq, robot) if seen else (),
            risks=bytes((seq + k * k) % 3 for k in range(len(command_grid(robot)))) if seen else b"",
        )
        samples.append(sample)
        before = v_mps, w_radps
        x_m, y_m, yaw_rad = step_unicycle(x_m, y_m, yaw_rad, v_mps, w_radps, clock.dt_s)
    return tuple(samples)


def crooked_episode(
    index: int = 3, sample_count: int = 24, *, robot: RobotConfig = ROBOT, **changes: Any
) -> tuple[EpisodeHeader, tuple[Sample, ...]]:
    """Header and samples of a failed episode; `changes` are those of the header."""
    header = crooked_header(index, sample_count, robot=robot, **changes)
    return header, crooked_samples(header, robot=robot)


def write_crooked_shard(
    folder: Path, indices: Iterable[int] = (3,), sample_count: int = 24, *, robot: RobotConfig = ROBOT, **changes: Any
) -> Path:
    """A shard of failed episodes with colours and depths of all cameras, and what the expert would have done."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / shard_name("r0", 0)
    names = ("depth", *(f"{name}.{kind}" for name in robot.cameras for kind in ("rgb", "depth")), "expert")
    with ShardWriter(path, crooked_provenance(robot), outputs=names, fsync=False) as writer:
        for index in indices:
            header, samples = crooked_episode(index, sample_count, robot=robot, **changes)
            writer.append(encode_episode(header, 2, samples))
    return path


def human_places(seq: int, robot: RobotConfig = ROBOT) -> tuple[tuple[float, float, float, float], ...]:
    """Where the humans are at a sample: x, y, z [m], yaw [rad]."""
    time_s = seq * robot.clock.dt_s
    return tuple(
        (x + time_s * vx, y + time_s * vy, z, yaw + 0.3 * time_s)
        for (x, y, z, yaw), (vx, vy) in zip(HUMANS_XYZYAW, HUMANS_MPS, strict=True)
    )


def crooked_avatar(name: str = "crooked") -> Avatar:
    """A body that is not square: long legs wide apart, a short trunk, long feet, arms of a small person."""
    avatar = make_avatar(name)
    joints = avatar.joints_tpose_m.astype(np.float64)
    side = np.sign(joints[:, 0])
    legs, feet, trunk = [1, 2, 4, 5, 7, 8, 10, 11], [10, 11], [3, 6, 9, 12, 13, 14, 15, *range(16, 24)]
    joints[legs, 0] += 0.06 * side[legs]
    joints[[0, 1, 2, 4, 5], 1] *= 1.15
    joints[feet, 2] += 0.05
    joints[trunk, 1] = joints[0, 1] + 0.8 * (joints[trunk, 1] - avatar.joints_tpose_m[0, 1])
    joints[16:, 0] *= 0.85
    joints = joints.astype(np.float32)
    return dataclasses.replace(avatar, joints_tpose_m=joints, joints_canonical_m=joints, height_m=1.71)


def _further_images(header: EpisodeHeader, number: int) -> dict[str, bytes]:
    """Depths of the first camera, colours and depths of the others."""
    images = {"depth": encode_output(make_images(number, header.height_px, header.width_px), "depth")}
    for place, camera in enumerate(header.cameras, 1):
        size = camera.height_px, camera.width_px
        images[f"{camera.name}.rgb"] = jpeg(number + 500 * place, *size)
        images[f"{camera.name}.depth"] = encode_output(make_images(number + 500 * place, *size), "depth")
    return images


def _expert(before: Sequence[float], seq: int, robot: RobotConfig) -> tuple[tuple[float, float], ...]:
    """What the expert would have executed: it brakes and turns to the left."""
    commands = []
    v_mps, w_radps = before
    for k in range(EXPERT_AHEAD):
        v_mps, w_radps = limit_command(0.11, 0.7 - 0.05 * (seq + k), v_mps, w_radps, robot, robot.clock.dt_s)
        commands.append((v_mps, w_radps))
    return tuple(commands)
