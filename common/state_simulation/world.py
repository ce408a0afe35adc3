"""What every robot of a state simulation shares: map, cameras, limits and rules, as a tuple of arrays and numbers."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, UInt32Array
from readygo.common.camera.view import view_of
from readygo.common.config import Range, check_ranges
from readygo.common.episode.config import EpisodeConfig
from readygo.common.errors import ConfigError
from readygo.common.maps import OccupancyMap, SightMap, clearance_m
from readygo.common.robot import RobotConfig
from readygo.common.state_simulation.goal_distances import Place, coarse_place

RAY_COUNT = 32
"""Directions in which the robot is told the free distance."""
RAY_M = 8.0
"""Longest free distance that is told [m]."""
VIEW_RANGE_M = 10.0
"""People farther away are not perceived [m]; as the expert's."""


@dataclass(frozen=True, kw_only=True)
class ObservationConfig:
    """What a robot is told."""

    rays: Literal["around", "view"] = "around"
    """Directions of the free distances: all round, from the map, or within the first camera's view."""
    path: bool = True
    """True tells where the shortest path to the goal leads, and its length: for robots that know their map."""
    people: Annotated[int, Range(low=1, high=8)] = 3
    """People that are told, the nearest ones."""
    arcs: bool = True
    """True tells where 15 commands would lead if they were held: to obstacles of the map, and how near to people."""

    def __post_init__(self) -> None:
        check_ranges(self)


ARC_SPEEDS, ARC_TURNS = (0.5, 1.0), (-1.0, -2 / 3, -1 / 3, 0.0, 1 / 3, 2 / 3, 1.0)
"""Commands of the told arcs, in shares of the robot's limits; and standing."""


class RobotLimits(NamedTuple):
    """The numbers of a `RobotConfig` that motion depends on, by the same names."""

    radius_m: float
    v_min_mps: float
    v_max_mps: float
    w_max_radps: float
    a_max_mps2: float
    alpha_max_radps2: float


class StateWorld(NamedTuple):
    """Map, robot and rules."""

    occupied: BoolArray
    """The robot's map, shape (H, W)."""
    clearance_m: Float32Array
    """Free space around each cell of it [m], shape (H, W)."""
    place: Place
    """Where the map is."""
    opaque: UInt32Array
    """What hides people, see `SightMap`."""
    sight_place: tuple[float, float, float, float]
    """Where that map is: origin x, y, resolution, height of a layer [m]."""
    coarse: Place
    """Where the cells of remaining distances are."""
    robot: RobotLimits
    cameras: Float64Array
    """By camera: the five numbers of its `FieldOfView`, mount x, y [m] and yaw [rad], shape (C, 8)."""
    bearings_rad: Float64Array
    """Directions of the rays in the robot's frame, shape (RAY_COUNT,)."""
    arcs: Float64Array
    """v [m/s], w [rad/s] of the told arcs, shape (R, 2)."""
    tells_path: bool
    told_people: int
    success_radius_m: float
    human_radius_m: float
    contact_m: float
    """Distance of the centres at which robot and human touch [m]."""
    dt_s: float
    control_every: int
    """Steps from one command to the next."""
    step_limit: int


def make_world(
    robot_map: OccupancyMap,
    sight: SightMap,
    robot: RobotConfig,
    episode: EpisodeConfig,
    observation: ObservationConfig,
) -> StateWorld:
    """The world of a scene.

    Args:
        robot_map: What blocks the robot.
        sight: What hides people.
        robot: One robot, not a range of them.
        episode: Task and judging.
        observation: What robots are told.

    Raises:
        ConfigError: If the robot has ranges.
    """
    if robot.ranges.varies:
        raise ConfigError("The state simulation has one robot: leave [ranges] out of robot.toml.")
    frame, sight_frame, clock = robot_map.frame, sight.frame, robot.clock
    return StateWorld(
        occupied=robot_map.occupied,
        clearance_m=clearance_m(robot_map),
        place=(frame.origin_x_m, frame.origin_y_m, frame.resolution_m),
        opaque=sight.opaque,
        sight_place=(sight_frame.origin_x_m, sight_frame.origin_y_m, sight_frame.resolution_m, sight.layer_m),
        coarse=coarse_place(frame),
        robot=RobotLimits(*(float(getattr(robot, name)) for name in RobotLimits._fields)),
        cameras=camera_views(robot),
        bearings_rad=_bearings_rad(robot, observation),
        arcs=_arcs(robot) if observation.arcs else np.zeros((0, 2)),
        tells_path=observation.path,
        told_people=observation.people,
        success_radius_m=float(episode.success_radius_m),
        human_radius_m=float(episode.human_radius_m),
        contact_m=float(robot.radius_m + episode.human_radius_m),
        dt_s=clock.dt_s,
        control_every=clock.control_every,
        step_limit=clock.steps(episode.time_limit_s),
    )


def camera_views(robot: RobotConfig) -> Float64Array:
    """What a robot's cameras show, as in `StateWorld.cameras`, shape (C, 8)."""
    mounts = [
        (*view_of(camera), camera.mount_x_m, camera.mount_y_m, math.radians(camera.mount_yaw_deg))
        for camera in robot.all_cameras.values()
    ]
    return np.array(mounts, np.float64)


def _arcs(robot: RobotConfig) -> Float64Array:
    shares = [(0.0, 0.0), *((speed, turn) for speed in ARC_SPEEDS for turn in ARC_TURNS)]
    arcs: Float64Array = np.array(shares) * (robot.v_max_mps, robot.w_max_radps)
    return arcs


def _bearings_rad(robot: RobotConfig, observation: ObservationConfig) -> Float64Array:
    if observation.rays == "around":
        return np.arange(RAY_COUNT, dtype=np.float64) * (math.tau / RAY_COUNT)
    view, yaw_rad = view_of(robot.camera), math.radians(robot.camera.mount_yaw_deg)
    within: Float64Array = yaw_rad + np.linspace(-view.right_rad, view.left_rad, RAY_COUNT)
    return within
