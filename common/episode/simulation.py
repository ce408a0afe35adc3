"""An episode, step by step: the robot moves, humans follow their motions, every step is judged."""

import math

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array
from readygo.common.episode.collision import meets_human, meets_obstacle
from readygo.common.episode.config import EpisodeConfig
from readygo.common.errors import SceneError
from readygo.common.frames import goal_in_robot_frame
from readygo.common.maps import OccupancyMap
from readygo.common.messages.episode import Scenario
from readygo.common.messages.motion import EpisodeMotions
from readygo.common.messages.plan import Outcome, RobotTrajectory
from readygo.common.robot import RobotConfig, limit_command, step_unicycle


class EpisodeSimulation:
    """The closed loop that the expert is recorded in and policies are judged in, by the steps of the robot's clock.

    The episode starts at rest. Humans follow the roots of their motions and do not react to the robot.
    """

    def __init__(
        self,
        scenario: Scenario,
        motions: EpisodeMotions,
        robot_map: OccupancyMap,
        robot: RobotConfig,
        episode_config: EpisodeConfig,
    ) -> None:
        """Put the robot at its start.

        Raises:
            SceneError: If the start meets an obstacle of the robot's map.
            ValueError: If scenario and motions do not have the same number of humans.
        """
        if len(scenario.humans) != len(motions.humans):
            raise ValueError(
                f"{scenario.episode.episode_id} has {len(scenario.humans)} humans but {len(motions.humans)} motions."
            )
        self.scenario = scenario
        self.motions = motions
        self.robot_map = robot_map
        self.robot = robot
        self.clock = robot.clock
        self.config = episode_config
        self.outcome: Outcome | None = None
        """How the episode ended; None while it runs."""
        self.step = 0
        """Number of steps done."""
        self.x_m, self.y_m, self.yaw_rad = (float(value) for value in scenario.start_xyyaw)
        self.v_mps = self.w_radps = 0.0
        self._wanted = (0.0, 0.0)
        if meets_obstacle(robot_map, self.x_m, self.y_m, robot.radius_m):
            raise SceneError(
                f"{scenario.episode.episode_id} starts in an obstacle at ({self.x_m:.2f}, {self.y_m:.2f}); "
                "plan it on the same map."
            )
        self._step_limit = self.clock.steps(episode_config.time_limit_s)
        self.contact_m = robot.radius_m + episode_config.human_radius_m
        """Distance of the centres at which robot and human touch [m]."""
        self._walked_m = _side_by_side([human.motion.root_m[:, :2].astype(np.float64) for human in motions.humans])
        self._rows = np.empty((self._step_limit, 5))

    @property
    def time_s(self) -> float:
        """Simulated time since the episode began [s]."""
        return self.step / self.clock.rate_hz

    @property
    def time_ns(self) -> int:
        """Simulated time since the episode began [ns]."""
        return self.clock.time_ns(self.step)

    @property
    def goal_xy_robot_m(self) -> tuple[float, float]:
        """Goal in the robot's frame (x forward, y left) [m]."""
        return goal_in_robot_frame(self.x_m, self.y_m, self.yaw_rad, self.scenario.goal_xy_m)

    @property
    def goal_distance_m(self) -> float:
        """Straight distance to the goal [m]."""
        goal_x, goal_y = self.scenario.goal_xy_m.tolist()
        return math.hypot(goal_x - self.x_m, goal_y - self.y_m)

    @property
    def human_xy_m(self) -> Float64Array:
        """Where the humans are now [m], shape (N, 2)."""
        return self.human_xy_at(self.step)

    def motions_so_far(self) -> EpisodeMotions:
        """How the humans move, at least until now: all of it, unless they decide as they go."""
        return self.motions

    def path_xyyaw(self, first: int, last: int) -> Float64Array:
        """The robot at steps `first` to `last`, at most the present one: x [m], y [m], yaw [rad], shape (T, 3)."""
        present = [(self.x_m, self.y_m, self.yaw_rad)] if last == self.step else np.empty((0, 3))
        path: Float64Array = np.concatenate([self._rows[first : min(last + 1, self.step), :3], present])
        return path

    def human_xy_at(self, step: int) -> Float64Array:
        """Where the humans are at a step [m], shape (N, 2)."""
        here: Float64Array = self._walked_m[min(step, len(self._walked_m) - 1)]
        return here

    def hold(self, v_mps: float, w_radps: float) -> None:
        """Have the robot follow a command until the next one, also where none is due: what it once executed, say."""
        self._wanted = v_mps, w_radps

    def advance(self, v_mps: float, w_radps: float) -> Outcome | None:
        """Command the robot for one step, within its limits.

        A robot that is not commanded at every step holds what it was commanded last.

        Returns:
            How the episode ended with this step, or None.

        Raises:
            ValueError: If the episode has ended or the command is not finite.
        """
        if self.outcome is not None:
            raise ValueError(f"{self.scenario.episode.episode_id} has ended ({self.outcome.value}).")
        if not (math.isfinite(v_mps) and math.isfinite(w_radps)):
            raise ValueError(f"a command must be finite, got ({v_mps}, {w_radps}).")
        if self.clock.commands(self.step):
            self.hold(v_mps, w_radps)
        v, w = limit_command(*self._wanted, self.v_mps, self.w_radps, self.robot, self.clock.dt_s)
        self._rows[self.step] = (self.x_m, self.y_m, self.yaw_rad, v, w)
        self.x_m, self.y_m, self.yaw_rad = step_unicycle(self.x_m, self.y_m, self.yaw_rad, v, w, self.clock.dt_s)
        self.v_mps, self.w_radps = v, w
        self.step += 1
        self.outcome = self._judge()
        return self.outcome

    def trajectory(
        self,
        *,
        human_visible: npt.ArrayLike | None = None,
        replanned: npt.ArrayLike | None = None,
        expert_cost: npt.ArrayLike | None = None,
        replan_times_s: npt.ArrayLike = (),
    ) -> RobotTrajectory:
        """The run so far, one row per step that was done.

        Args:
            human_visible: What the robot perceived at each step, shape (T,); False without.
            replanned: Steps at which the expert replanned, shape (T,); False without.
            expert_cost: Cost of the plan in force, shape (T,); 0 without.
            replan_times_s: CPU time of each replan [s].

        Raises:
            ValueError: If the episode still runs, or an array does not have T entries.
        """
        if self.outcome is None:
            raise ValueError(f"{self.scenario.episode.episode_id} still runs at step {self.step}.")
        rows = self._rows[: self.step]
        distance_m, collision_s = self._proximity(rows)
        zeros = np.zeros(self.step)
        return RobotTrajectory(
            outcome=self.outcome,
            xyyaw=rows[:, :3].copy(),
            actions=rows[:, 3:].copy(),
            replanned=np.asarray(zeros if replanned is None else replanned, dtype=np.bool_),
            human_visible=np.asarray(zeros if human_visible is None else human_visible, dtype=np.bool_),
            human_distance_m=distance_m,
            time_to_collision_s=collision_s,
            expert_cost=np.asarray(zeros if expert_cost is None else expert_cost, dtype=np.float64),
            replan_times_s=np.asarray(replan_times_s, dtype=np.float64),
            rate_hz=self.clock.rate_hz,
        )

    def _judge(self) -> Outcome | None:
        if meets_obstacle(self.robot_map, self.x_m, self.y_m, self.robot.radius_m):
            return Outcome.STATIC_COLLISION
        if meets_human(self.x_m, self.y_m, self.human_xy_m, self.contact_m):
            return Outcome.HUMAN_COLLISION
        if self.goal_distance_m <= self.config.success_radius_m:
            return Outcome.SUCCESS
        return Outcome.TIMEOUT if self.step >= self._step_limit else None

    def _proximity(self, rows: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Distance to the nearest human [m] and time to collision [s] of each row."""
        distance_m, collision_s = np.full(len(rows), np.inf), np.full(len(rows), np.inf)
        dt_s = self.clock.dt_s
        walked_m = np.array([self.human_xy_at(step) for step in range(len(rows) + 1)])
        for human in range(walked_m.shape[1]):
            here, there = walked_m[:-1, human].tolist(), walked_m[1:, human].tolist()
            for k, (x, y, yaw, v, _) in enumerate(rows.tolist()):
                offset_m = here[k][0] - x, here[k][1] - y
                v_mps = (there[k][0] - here[k][0]) / dt_s, (there[k][1] - here[k][1]) / dt_s
                near_m, contact_s = nearness(offset_m, v_mps, yaw, v, self.contact_m)
                distance_m[k] = min(distance_m[k], near_m)
                collision_s[k] = min(collision_s[k], contact_s)
        return distance_m, collision_s


def _side_by_side(paths_m: list[Float64Array]) -> Float64Array:
    """Paths of shape (T, 2) [m] as one array, shape (longest T, N, 2); a human who arrives early stays there."""
    length = max((len(path) for path in paths_m), default=1)
    together = np.empty((length, len(paths_m), 2))
    for index, path in enumerate(paths_m):
        together[: len(path), index] = path
        together[len(path) :, index] = path[-1]
    return together


def nearness(
    offset_m: tuple[float, float], v_mps: tuple[float, float], yaw_rad: float, robot_mps: float, contact_m: float
) -> tuple[float, float]:
    """Distance of a human from a robot that drives in a straight line [m], and time until they touch [s].

    Args:
        offset_m: From the robot to the human.
        v_mps: The human's velocity.
        yaw_rad: Where the robot drives to.
        robot_mps: How fast.
        contact_m: Distance at which they touch [m].
    """
    (dx, dy), (vx, vy) = offset_m, v_mps
    vx, vy = vx - robot_mps * math.cos(yaw_rad), vy - robot_mps * math.sin(yaw_rad)
    return math.sqrt(dx * dx + dy * dy), time_to_contact_s(dx, dy, vx, vy, contact_m)


def time_to_contact_s(dx_m: float, dy_m: float, vx_mps: float, vy_mps: float, contact_m: float) -> float:
    """Time until two points at a relative position and velocity are `contact_m` apart [s]; inf if never, 0 if now."""
    gap = dx_m * dx_m + dy_m * dy_m - contact_m * contact_m
    if gap <= 0:
        return 0.0
    speed_squared, closing = vx_mps * vx_mps + vy_mps * vy_mps, dx_m * vx_mps + dy_m * vy_mps
    root = closing * closing - speed_squared * gap
    if closing >= 0 or root < 0:
        return math.inf
    # The smaller root of |d + v t| = contact, in the form that keeps precision when the speed is small.
    return gap / (-closing + math.sqrt(root))
