"""A flat of four rooms, a toy avatar, and planners for them."""

from dataclasses import dataclass

import numpy as np

from readygo.common.avatars import SMPL_PARENTS, Avatar
from readygo.common.episode import EpisodeConfig
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap, sight_of_occupancy
from readygo.common.messages import EpisodeKey, EpisodeMotions, HumanMotion, Split
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig, HumanPlanner, HumanPlannerConfig, RobotPlanner
from readygo.services.planner.humans.config import FamilyMix
from tests.common.episode.upright import upright_motion

FRAME = GridFrame(origin_x_m=-3.0, origin_y_m=2.0, resolution_m=0.05)
DOORS = ((0.1, 6.98), (6.1, 6.98), (2.98, 4.6), (2.98, 9.6))
"""Middles of the doors of `rooms` [m]."""


@dataclass(frozen=True)
class Maps:
    robot: OccupancyMap
    human: OccupancyMap
    floor: FloorMap

    @property
    def sight(self):
        return sight_of_occupancy(self.robot)


def rooms():
    """12 x 10 m: four rooms with doors of 1.2 m, a table, a cupboard."""
    occupied = np.zeros((200, 240), np.bool_)
    occupied[:2] = occupied[-2:] = True
    occupied[:, :2] = occupied[:, -2:] = True
    occupied[98:101] = True
    occupied[:, 118:121] = True
    for rows, columns in ((slice(98, 101), slice(50, 74)), (slice(98, 101), slice(170, 194))):
        occupied[rows, columns] = False
    for rows, columns in ((slice(40, 64), slice(118, 121)), (slice(140, 164), slice(118, 121))):
        occupied[rows, columns] = False
    occupied[25:50, 60:80] = True
    occupied[150:160, 200:230] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def make_avatar(name):
    """A pillar of Gaussians, 0.4 m wide, that moves with the pelvis."""
    rng = np.random.default_rng(0)
    count = 200
    means = rng.uniform((-0.2, 0.0, -0.2), (0.2, 1.8, 0.2), (count, 3)).astype(np.float32)
    joints = np.zeros((24, 3), np.float32)
    joints[:, 1] = 0.9
    assert len(SMPL_PARENTS) == 24
    return Avatar(
        name=name,
        license="CC0",
        height_m=1.8,
        cloud=GaussianCloud(
            means_m=means,
            quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
            scales_m=np.full((count, 3), 0.02, np.float32),
            opacities=np.full(count, 0.9, np.float32),
            sh=np.zeros((count, 1, 3), np.float32),
        ),
        lbs_index=np.zeros((count, 4), np.uint8),
        lbs_weight=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        joints_canonical_m=joints,
        joints_tpose_m=joints,
        R_tpose_canonical=np.tile(np.eye(3, dtype=np.float32), (24, 1, 1)),
    )


def animate(scenario):
    """Stand-in for the animator: roots on the trajectories, no limbs."""
    humans = (HumanMotion(avatar=human.avatar, motion=upright_motion(human.xy_m)) for human in scenario.humans)
    return EpisodeMotions(humans=tuple(humans))


def key(index, split=Split.TEST, seed=1):
    """An episode's key."""
    return EpisodeKey(seed=seed, split=split, index=index)


AVATAR_NAMES = ("adam", "mia", "zoe")


def maps_of(occupancy=None, height_m=None):
    """Maps with the same cells for robot and humans, on a flat floor by default."""
    occupancy = occupancy or rooms()
    height = np.zeros(occupancy.occupied.shape, np.float32) if height_m is None else height_m
    return Maps(occupancy, occupancy, FloorMap(frame=occupancy.frame, height_m=height))


def make_robot_planner(occupancy=None, **expert):
    """An expert on one map."""
    avatars = {name: make_avatar(name) for name in AVATAR_NAMES}
    return RobotPlanner(maps_of(occupancy), avatars, RobotConfig(), EpisodeConfig(), ExpertConfig(**expert))


def make_human_planner(
    maps=None, *, avatar_names=AVATAR_NAMES, episode=None, config=None, scenarios=None, make_expert=None
):
    """A planner of scenarios."""
    return HumanPlanner(
        maps or maps_of(),
        avatar_names,
        RobotConfig(),
        episode or EpisodeConfig(),
        config or HumanPlannerConfig(),
        scenarios=scenarios,
        make_expert=make_expert,
    )


def planner_of(family="", *, occupancy=None, height_m=None, people=(1, 1), scenarios=None, **config):
    """A planner that draws one family, or what `config` says, or plays a scenario file."""
    mix = {"mix": FamilyMix(**{family: 1.0})} if family else {}
    return make_human_planner(
        maps_of(occupancy, height_m),
        episode=EpisodeConfig(
            human_count_min=people[0], human_count_max=people[1], human_speed_min_mps=0.5, human_speed_max_mps=2.0
        ),
        config=HumanPlannerConfig(**{**mix, **config}),
        scenarios=scenarios,
        make_expert=make_robot_planner(occupancy).expert if config.get("reactive") else None,
    )


def hall():
    """A room of 11 x 9 m without anything in it."""
    occupied = np.ones((200, 240), np.bool_)
    occupied[10:190, 10:230] = False
    return OccupancyMap(frame=FRAME, occupied=occupied)
