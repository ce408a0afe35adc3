"""The episodes of the planning benchmark: every index is drawn once, and every expert drives through it."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np
from numba.core.event import install_recorder

from readygo.benchmarks.planning.clearance import gaussian_clearance_m
from readygo.benchmarks.planning.maps import MapSource, open_maps
from readygo.common.arrays import BoolArray
from readygo.common.avatars import FootprintModel, load_avatars
from readygo.common.camera.view import view_of
from readygo.common.drawing.files import png_bytes
from readygo.common.episode import EpisodeConfig, EpisodeResult, shortest_way_m
from readygo.common.maps import clearance_m
from readygo.common.messages import (
    AnimateRequest,
    EpisodeKey,
    EpisodeMotions,
    HumanPlanRequest,
    Outcome,
    RobotPlanRequest,
    RobotTrajectory,
    Scenario,
    Split,
)
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import RATE_HZ
from readygo.services.animator import Animator, AnimatorConfig, handle_animate
from readygo.services.planner import (
    HumanPlanner,
    HumanPlannerConfig,
    RobotPlanner,
    expert_recipe,
    handle_human_plan,
    handle_robot_plan,
)
from readygo.services.planner.expert.interface import HumanBody
from readygo.services.planner.explain.picture import draw_episode
from readygo.services.planner.humans.mixes import MIXES, MixName

T = TypeVar("T")

REJECTED_MAX = 300
"""Draws without a scenario, one after the other, that make a map unusable."""
FREE_HUMAN_M = 3.0
FREE_GAP_M = 0.3
"""Free stretches: no human is in view or within FREE_HUMAN_M, and walls leave FREE_GAP_M beside the disc [m]."""
START_S = 1.0
"""The time that a robot needs to reach its speed takes no part in that of free stretches [s]."""


@dataclass(frozen=True, kw_only=True)
class PlanningJob:
    """What is run on one map."""

    source: MapSource
    modes: tuple[str, ...]
    tasks: tuple[str, ...]
    seed: int
    people: MixName = "paper"
    """The mix of people: a recipe of the planner."""
    pictures: Path | None = None
    """Folder for a picture of every failure."""


@dataclass(frozen=True, kw_only=True)
class PlanningRun:
    """One expert's drive through one episode."""

    result: EpisodeResult
    failure: str
    """Its category; empty for a success."""
    closest_m: float
    """Smallest distance of the centres of robot and nearest human [m]; inf without humans."""
    avatar_gap_m: float | None
    """Smallest distance of the robot's disc to an avatar's Gaussians [m]; None without humans."""
    turn_change_radps: float
    """Sum of |change of w| over the run [rad/s]."""
    free_m: float
    """Way driven on free stretches [m]."""
    free_s: float
    """Time on free stretches [s]."""
    replan_ms: tuple[float, ...]
    """CPU time of each replan [ms]."""
    expert_ms: float
    """CPU time of the whole drive [ms]."""


@dataclass(frozen=True, kw_only=True)
class Draw:
    """One index: why it has no episode, or how all experts drove through it."""

    index: int
    rejected: str = ""
    scenario_ms: float = 0.0
    """CPU time of drawing the scenario, or of finding out that there is none [ms]."""
    motion_ms: float = 0.0
    runs: dict[tuple[str, str], PlanningRun] = field(default_factory=dict)
    """Runs by task and mode."""
    pictures: dict[str, bytes] = field(default_factory=dict)
    """Failures as PNG, by their path in the folder of pictures; empty where they are not wanted or written already."""


class Course:
    """One map with all experts, ready to drive; kept by a process while it works on the map."""

    def __init__(self, job: PlanningJob) -> None:
        """Open the maps and drive once, so that compiled code is loaded before a clock runs.

        Raises:
            SceneError: If the maps cannot be used.
        """
        self.job, self.robot = job, RobotConfig()
        self.episode, human_config = MIXES[job.people](EpisodeConfig(), HumanPlannerConfig())
        self.maps, avatars = open_maps(job.source), load_avatars()
        self.human_planner = HumanPlanner(self.maps, sorted(avatars), self.robot, self.episode, human_config)
        self.robot_planners = {
            mode: RobotPlanner(self.maps, avatars, self.robot, self.episode, expert_recipe(mode)) for mode in job.modes
        }
        self._bodies = {name: (avatar, FootprintModel.from_avatar(avatar)) for name, avatar in avatars.items()}
        self.animator = Animator(avatars, self.maps.floor, AnimatorConfig())
        self._clearance_m = clearance_m(self.maps.robot)
        for index in range(REJECTED_MAX):
            if not self.draw(index, pictured=False).rejected:
                return

    def draw(self, index: int, *, pictured: bool) -> Draw:
        """Draw an index and let every expert drive through it; an index counts if its dynamic scenario does."""
        key = EpisodeKey(seed=self.job.seed, split=Split.TEST, index=index)
        plan, scenario_ms = timed(lambda: handle_human_plan(self.human_planner, HumanPlanRequest(episode=key)))
        if plan.scenario is None:
            return Draw(index=index, rejected=plan.rejected, scenario_ms=scenario_ms)
        request = AnimateRequest(scenario=plan.scenario)
        animated, motion_ms = timed(lambda: handle_animate(self.animator, request))
        if animated.motions is None:
            return Draw(index=index, rejected="motion", scenario_ms=scenario_ms)
        still = handle_human_plan(self.human_planner, HumanPlanRequest(episode=key, static=True)).scenario
        assert still is not None
        episodes = {"dynamic": (plan.scenario, animated.motions), "static": (still, EpisodeMotions(humans=()))}
        draw = Draw(index=index, scenario_ms=scenario_ms, motion_ms=motion_ms)
        for task, mode in product(self.job.tasks, self.job.modes):
            scenario, motions = episodes[task]
            trajectory, run = self._drive(mode, scenario, motions)
            draw.runs[task, mode] = run
            if pictured and run.failure:
                kind = run.failure.replace(", ", "_").replace(" ", "-")
                picture = draw_episode(self.maps.robot, scenario, trajectory, motions=motions)
                name = f"{self.job.source.name}_{task}/{mode}/{kind}/{key.episode_id}.png"
                draw.pictures[name] = png_bytes(picture)
        return draw

    def _drive(self, mode: str, scenario: Scenario, motions: EpisodeMotions) -> tuple[RobotTrajectory, PlanningRun]:
        request = RobotPlanRequest(scenario=scenario, motions=motions)
        reply, expert_ms = timed(lambda: handle_robot_plan(self.robot_planners[mode], request))
        run = reply.trajectory
        assert run is not None
        failure = self._failure(run, motions)
        free = self._free_steps(run)
        return run, PlanningRun(
            result=EpisodeResult.from_trajectory(run, self._shortest_m(scenario)),
            failure=failure,
            closest_m=float(run.human_distance_m.min()),
            avatar_gap_m=self._avatar_gap_m(run, motions),
            turn_change_radps=float(np.abs(np.diff(run.actions[:, 1], prepend=0.0)).sum()),
            free_m=float(np.abs(run.actions[free, 0]).sum()) / RATE_HZ,
            free_s=float(free.sum()) / RATE_HZ,
            replan_ms=tuple(1e3 * t for t in run.replan_times_s.tolist()),
            expert_ms=expert_ms,
        )

    def _shortest_m(self, scenario: Scenario) -> float:
        start, goal = scenario.start_xyyaw.tolist(), scenario.goal_xy_m.tolist()
        return shortest_way_m(
            self.maps.robot,
            self.robot.radius_m,
            (start[0], start[1]),
            (goal[0], goal[1]),
            goal_radius_m=self.episode.success_radius_m,
        )

    def _failure(self, run: RobotTrajectory, motions: EpisodeMotions) -> str:
        """How a run failed: of human collisions also where the human was and whether the robot moved."""
        if run.outcome is Outcome.SUCCESS:
            return ""
        if run.outcome is not Outcome.HUMAN_COLLISION:
            return str(run.outcome.value).replace("_", " ")
        step = len(run.xyyaw) - 1
        x, y, yaw = run.xyyaw[-1].tolist()
        roots = [human.motion.root_m[human.motion.row(step), :2].tolist() for human in motions.humans]
        dx, dy = min(((hx - x, hy - y) for hx, hy in roots), key=lambda gap: math.hypot(*gap))
        bearing = (math.atan2(dy, dx) - yaw + math.pi) % (2 * math.pi) - math.pi
        shown = view_of(self.robot.camera)
        seen = -shown.right_rad <= bearing <= shown.left_rad
        moving = run.actions[-1, 0] >= 0.1
        return f"human {'in' if seen else 'out of'} view, robot {'moving' if moving else 'standing'}"

    def _avatar_gap_m(self, run: RobotTrajectory, motions: EpisodeMotions) -> float | None:
        bodies = [HumanBody(human, *self._bodies[human.avatar]) for human in motions.humans]
        gap_m = gaussian_clearance_m(run.xyyaw, bodies, self.maps.floor, self.robot)
        return gap_m if math.isfinite(gap_m) else None

    def _free_steps(self, run: RobotTrajectory) -> BoolArray:
        frame = self.maps.robot.frame
        cells = np.array([frame.cell(x, y) for x, y in run.xyyaw[:, :2].tolist()])
        wide = self._clearance_m[cells[:, 0], cells[:, 1]] > self.robot.planning_radius_m + FREE_GAP_M
        late = np.arange(len(cells)) >= START_S * RATE_HZ
        free: BoolArray = wide & late & ~run.human_visible & (run.human_distance_m > FREE_HUMAN_M)
        return free


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """A call's result and its CPU time on this thread [ms].

    If kernels were compiled meanwhile, the call is made again: it must be a pure function.
    """
    while True:
        with install_recorder("numba:compile") as compiled:
            begin_s = time.thread_time()
            result = call()
            spent_ms = 1e3 * (time.thread_time() - begin_s)
        if not compiled.buffer:
            return result, spent_ms
