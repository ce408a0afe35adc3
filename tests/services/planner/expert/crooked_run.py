"""A run of the expert in which no value is round or symmetric."""

import dataclasses

import numpy as np

from readygo.common.camera import CameraConfig
from readygo.common.episode import EpisodeConfig
from readygo.common.robot import RobotConfig
from readygo.services.planner import ExpertConfig, RobotPlanner
from readygo.services.planner.expert.handlers import DecisionLog, drive
from tests.services.planner.runs import make_scenario
from tests.services.planner.worlds import AVATAR_NAMES, animate, make_avatar, maps_of


def crooked_run(mode, *, control_hz, camera_hz, **expert):
    """A robot that reverses, of other rates and limits, turned by 2.5 rad, among two who walk and one who stands."""
    robot = RobotConfig(
        control_hz=control_hz, camera_hz=camera_hz, radius_m=0.28, planning_radius_m=0.35, v_max_mps=0.9,
        v_min_mps=-0.4, w_max_radps=1.4, a_max_mps2=0.8, alpha_max_radps2=2.6,
        camera=CameraConfig(mount_yaw_deg=-12.0, mount_x_m=0.1, horizontal_fov_deg=110.0),
    )  # fmt: skip
    avatars = {name: make_avatar(name) for name in AVATAR_NAMES}
    planner = RobotPlanner(
        maps_of(), avatars, robot, EpisodeConfig(time_limit_s=18.0), ExpertConfig(mode=mode, **expert)
    )
    steps = np.arange(500) / robot.clock.rate_hz
    walks = (
        np.column_stack([0.1 + 0.2 * np.sin(steps), 8.5 - 0.9 * np.minimum(steps, 6.0)]),
        np.column_stack([1.9 - 0.6 * np.minimum(steps, 5.0), 4.5 + 0.27 * np.minimum(steps, 5.0)]),
        np.array([[0.9, 5.3]]),
    )
    scenario = make_scenario(*walks)
    scenario = dataclasses.replace(scenario, start_xyyaw=np.array([-1.9, 5.4, 2.5]), goal_xy_m=np.array([2.3, 5.9]))
    logs = []

    def observe(expert):
        logs.append(DecisionLog(expert))
        return logs

    run = drive(planner, scenario, animate(scenario), observe)
    return run, logs[0].decisions
