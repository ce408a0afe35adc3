"""The decision core of `readygo drive`: messages in, commands and stops out. It has no network and no clock."""

import enum
import math
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from readygo.apps.drive.calibration import Rectifier
from readygo.apps.drive.clock import RobotClock
from readygo.apps.drive.messages import GoalMessage, ImageMessage, OdometryMessage, VelocityMessage
from readygo.common.arrays import UInt8Array
from readygo.common.camera.depth import in_range
from readygo.common.frames import goal_in_robot_frame, wrap_angle
from readygo.common.images.names import RGB, camera_of, kind_of
from readygo.common.messages import Outcome
from readygo.common.policy import Policy
from readygo.common.policy.sight import camera_on, in_bytes, side_by_side
from readygo.common.robot import RobotConfig, limit_command

STALE_S = 0.3
"""The robot stops if its newest image or odometry is older than this [s]."""
TOGETHER_S = 0.03
"""Largest time difference between images of one moment [s]; half of the images' period if that is longer."""
WAITING_MAX = 8
"""Largest number of images per camera that wait for the other cameras' images of the same time."""
GIVE_UP_S = 10.0
"""A trial ends after this time without images or odometry [s]."""
LEAP_M = 0.5
"""A larger jump of the odometry between two messages, beyond the robot's motion, means that it was reset [m]."""
LEAP_RAD = 0.5
"""The same of its heading [rad]."""

_PERIOD_SLACK = 0.8
"""Share of the control period after which the next decision may be made."""


class TrialEnding(enum.Enum):
    """Reason for the end of a trial."""

    GOAL = "at the goal"
    LATE = "out of time"
    STATIC_COLLISION = "hit a thing"
    HUMAN_COLLISION = "hit a human"
    STOPPED = "stopped by hand"
    STALE = "images or odometry stayed away"
    BROKEN_IMAGES = "images could not be used"
    BROKEN_MESSAGE = "a message could not be used"
    CLOCK = "the clock jumped"
    LEAP = "the odometry leapt"
    NOT_FINITE = "a number was not finite"
    FAILED = "the drive failed"

    @property
    def outcome(self) -> Outcome:
        """Outcome under which the trial counts."""
        return {
            TrialEnding.GOAL: Outcome.SUCCESS,
            TrialEnding.STATIC_COLLISION: Outcome.STATIC_COLLISION,
            TrialEnding.HUMAN_COLLISION: Outcome.HUMAN_COLLISION,
        }.get(self, Outcome.TIMEOUT)


@dataclass(frozen=True, kw_only=True)
class DriveConfig:
    """Settings of a trial."""

    v_max_mps: float
    """Largest speed [m/s]."""
    w_max_radps: float
    """Largest yaw rate, either way [rad/s]."""
    goal_radius_m: float = 1.0
    """Distance from the goal at which the robot has arrived [m]."""
    time_limit_s: float = 50.0
    """Longest successful trial [s]."""
    goal_in_start_frame: bool = True
    """True if the goal is relative to the robot's start pose (x forward, y left), not in the odometry's frame."""


class Pilot:
    """Drives one trial. One thread calls its methods; "now" and "arrived" are times of one monotonic clock [ns]."""

    def __init__(
        self,
        policy: Policy,
        rectify: Mapping[str, Rectifier],
        config: DriveConfig,
        goal: GoalMessage,
        goal_image: UInt8Array | None = None,
    ) -> None:
        """Begin a trial.

        Args:
            policy: Policy that drives.
            rectify: Rectifiers to the policy's cameras, by their names; the first camera is called "".
            config: Settings of the trial.
            goal: Goal of the trial.
            goal_image: The robot's camera image at the goal, for a policy with image goals: BGR, shape (H, W, 3).

        Raises:
            ValueError: If the goal image's size differs from the robot's camera.
        """
        spec = policy.spec
        self._policy, self._rectify, self._config = policy, rectify, config
        self._robot: RobotConfig = limit_speeds(spec.robot, config)
        self._clock, self._memory = RobotClock(), policy.start()
        if goal_image is not None:
            self._memory.show_goal(rectify[""](goal_image))
        self._given_goal, self.goal = goal, None if config.goal_in_start_frame else goal
        """Goal in the odometry's frame; None until the robot can drive if it is given in the start frame."""
        self._pose: OdometryMessage | None = None
        self._yaw_rad = 0.0
        self._together_ns = round(max(TOGETHER_S, 0.5 / spec.robot.camera_hz) * 1e9)
        self._waiting = {name: deque[ImageMessage](maxlen=WAITING_MAX) for name in spec.images}
        """Images received since the policy's last input, by name."""
        self._picture_ns: int | None = None
        """Stamp of the first camera's image in the policy's last input [ns]."""
        self._newest_ns: dict[str, int] = {}
        """Newest stamp of each image by name [ns]."""
        self._arrived_ns: dict[str, int] = {}
        self._wanted, self._sent = VelocityMessage(), VelocityMessage()
        self._sent_ns = self._decided_ns = 0
        self._stale_since_ns: int | None = None
        self.started_ns: int | None = None
        """Time at which all inputs were first available [ns]; None before."""
        self.ending: TrialEnding | None = None
        """Reason for the end of the trial; None while it runs."""
        self.reason = ""
        """Reason for the end of the trial in words; empty while it runs."""
        self.waiting_for = "images and odometry"
        """Missing inputs that keep the robot from driving, in words; empty while it drives."""
        self.straight_m = 0.0
        """Straight distance from the start to the circle around the goal [m]."""
        self.driven_m = 0.0
        """Length of the driven path, by the odometry [m]."""
        self.moving_mps = 0.0
        """Speed by the newest odometry [m/s]."""
        self.frame_age_s = 0.0
        """Age of the newest image on arrival [s]."""
        self.seen = 0
        """Number of the policy's inputs: images of the first camera that had all other images of their time."""
        self.seen_arrived_ns = 0
        """Arrival of the newest input [ns]."""

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the images that the policy uses."""
        return self._policy.spec.images

    def end(self, ending: TrialEnding, reason: str = "") -> None:
        """End the trial; later calls have no effect."""
        if self.ending is None:
            self.ending, self.reason = ending, reason or ending.value

    def hear(self, odometry: OdometryMessage, arrived_ns: int) -> None:
        """Process an odometry message: update pose, distance and clock."""
        values = (odometry.x_m, odometry.y_m, odometry.yaw_rad, odometry.v_mps, odometry.w_radps)
        if not all(map(math.isfinite, values)):
            self.end(TrialEnding.NOT_FINITE, "the odometry has numbers that are not finite")
            return
        stamp_ns, self._arrived_ns["odometry"] = odometry.stamp_ns or arrived_ns, arrived_ns
        self._check_clock(self._clock.hear("odometry", stamp_ns, arrived_ns))
        before = self._pose
        if before is not None:
            if stamp_ns <= before.stamp_ns:
                return
            self._check_leap(before, odometry, (stamp_ns - before.stamp_ns) / 1e9)
            self._yaw_rad += float(wrap_angle(odometry.yaw_rad - before.yaw_rad))
        else:
            self._yaw_rad = odometry.yaw_rad
        self._pose = replace(odometry, stamp_ns=stamp_ns)
        self.moving_mps = odometry.v_mps
        self._memory.move(stamp_ns, (odometry.x_m, odometry.y_m, self._yaw_rad))

    def look(self, picture: ImageMessage, arrived_ns: int, name: str = RGB) -> None:
        """Process an image; once all images of one time are there, the policy decides again.

        Args:
            picture: The image.
            arrived_ns: Its arrival [ns].
            name: Name of the image among the policy's inputs.
        """
        words = words_of(name, self._robot)
        stamp_ns, self._arrived_ns[words] = picture.stamp_ns or arrived_ns, arrived_ns
        self._check_clock(self._clock.hear(words, stamp_ns, arrived_ns))
        if name not in self._waiting or stamp_ns <= self._newest_ns.get(name, stamp_ns - 1):
            return
        self._newest_ns[name] = stamp_ns
        self._waiting[name].append(replace(picture, stamp_ns=stamp_ns))
        together = self._together()
        if together:
            self._see(together, arrived_ns)

    def _together(self) -> dict[str, ImageMessage]:
        """The newest waiting images of one time, by name; empty if there is no complete set."""
        for first in reversed(self._waiting[RGB]):
            found = {name: self._nearest(waiting, first.stamp_ns) for name, waiting in self._waiting.items()}
            together = {name: picture for name, picture in found.items() if picture is not None}
            if len(together) == len(found):
                return together
        return {}

    def _nearest(self, waiting: Iterable[ImageMessage], stamp_ns: int) -> ImageMessage | None:
        """The waiting image of a time; None if it has not arrived."""
        nearest = min(waiting, key=lambda picture: abs(picture.stamp_ns - stamp_ns), default=None)
        return None if nearest is None or abs(nearest.stamp_ns - stamp_ns) > self._together_ns else nearest

    def _see(self, together: Mapping[str, ImageMessage], arrived_ns: int) -> None:
        """Give a complete set of images to the policy, and let it decide."""
        for name, waiting in self._waiting.items():
            while waiting and waiting[0].stamp_ns <= together[name].stamp_ns:
                waiting.popleft()
        try:
            seen = {name: self._log_arrival(name, picture) for name, picture in together.items()}
            sight = side_by_side(seen, self._policy.spec.images)
        except ValueError as error:
            self.end(TrialEnding.BROKEN_IMAGES, f"the robot sends {error}")
            return
        picture = together[RGB]
        self._picture_ns = picture.stamp_ns
        self.frame_age_s = self._clock.age_s(picture.stamp_ns, arrived_ns)
        self.seen, self.seen_arrived_ns = self.seen + 1, arrived_ns
        if self._pose is None:
            return
        self._policy.see([self._memory], sight[None], [picture.stamp_ns])
        # A robot whose control rate is below its image rate holds its command.
        faster = self._robot.control_hz < self._robot.camera_hz
        if not faster or arrived_ns - self._decided_ns > (_PERIOD_SLACK / self._robot.control_hz) * 1e9:
            self._decide(arrived_ns)

    def _log_arrival(self, name: str, picture: ImageMessage) -> UInt8Array:
        """An image or depths, rectified to the policy's camera.

        Raises:
            ValueError: If the image cannot be decoded, or has a wrong size or kind.
        """
        rectify, pixels = self._rectify[camera_of(name)], picture.decode()
        if kind_of(name) == RGB:
            return rectify(pixels)
        robot = self._policy.spec.robot
        return in_bytes(in_range(rectify.depth(pixels), camera_on(robot, camera_of(name))), name, robot)

    def command(self, now_ns: int) -> VelocityMessage:
        """The command for the robot now: the latest decision within its limits, or a stop."""
        self._watch(now_ns)
        if self.ending is not None or self.waiting_for:
            wanted = self._wanted = VelocityMessage()
            self._sent, self._sent_ns = wanted, now_ns
            return wanted
        if self.started_ns is None:
            self.started_ns = now_ns
            # Images that came before the odometry led to no decision, which would have settled the goal.
            self._goal()
            self.straight_m = max(self.goal_distance_m - self._config.goal_radius_m, 0.0)
        self._decide_between(now_ns)
        passed_s = min((now_ns - self._sent_ns) / 1e9, self._robot.clock.dt_s)
        v, w = limit_command(
            self._wanted.v_mps, self._wanted.w_radps, self._sent.v_mps, self._sent.w_radps, self._robot, passed_s
        )
        self._sent, self._sent_ns = VelocityMessage(v_mps=v, w_radps=w), now_ns
        return self._sent

    @property
    def words(self) -> str:
        """State of the trial in one line."""
        if self.waiting_for:
            return f"standing: {self.waiting_for}"
        sent = self._sent
        return f"goal {self.goal_distance_m:.1f} m, v {sent.v_mps:.2f} m/s, w {sent.w_radps:+.2f} rad/s"

    @property
    def goal_distance_m(self) -> float:
        """Straight distance to the goal [m]; infinite before the odometry is known."""
        if self._pose is None or self.goal is None:
            return math.inf
        return math.hypot(self.goal.x_m - self._pose.x_m, self.goal.y_m - self._pose.y_m)

    def _decide_between(self, now_ns: int) -> None:
        """Decide again from the newest odometry if the control rate is above the image rate."""
        if self._robot.control_hz <= self._robot.camera_hz or self._decided_ns == 0:
            return
        if now_ns - self._decided_ns > (_PERIOD_SLACK / self._robot.control_hz) * 1e9:
            self._decide(now_ns)

    def _decide(self, now_ns: int) -> None:
        pose, goal = self._pose, self._goal()
        if pose is None or goal is None:
            return
        self._decided_ns = now_ns
        there = goal_in_robot_frame(pose.x_m, pose.y_m, self._yaw_rad, (goal.x_m, goal.y_m))
        moving = np.array([[pose.v_mps, pose.w_radps]], np.float32)
        v, w = self._policy.decide([self._memory], moving, np.array([there], np.float32))[0].tolist()
        if not (math.isfinite(v) and math.isfinite(w)):
            self.end(TrialEnding.NOT_FINITE, f"the policy commanded ({v:g}, {w:g})")
            return
        self._wanted = VelocityMessage(v_mps=v, w_radps=w)

    def _goal(self) -> GoalMessage | None:
        """The goal in the odometry's frame; from the first pose at which it is asked for on, it stays."""
        if self.goal is None and self._pose is not None:
            x, y, c, s = self._given_goal.x_m, self._given_goal.y_m, math.cos(self._yaw_rad), math.sin(self._yaw_rad)
            self.goal = GoalMessage(x_m=self._pose.x_m + c * x - s * y, y_m=self._pose.y_m + s * x + c * y)
        return self.goal

    def _watch(self, now_ns: int) -> None:
        """End the trial or stop the robot if it must not drive now."""
        if self.started_ns is not None and now_ns - self.started_ns >= self._config.time_limit_s * 1e9:
            self.end(TrialEnding.LATE)
        self.waiting_for = self._missing(now_ns)
        if self.waiting_for:
            since_ns = self._stale_since_ns = self._stale_since_ns or now_ns
            if self.started_ns is not None and now_ns - since_ns > GIVE_UP_S * 1e9:
                self.end(TrialEnding.STALE, f"{self.waiting_for} for {GIVE_UP_S:g} s")
            return
        self._stale_since_ns = None
        if self.goal_distance_m <= self._config.goal_radius_m:
            self.end(TrialEnding.GOAL)

    def _missing(self, now_ns: int) -> str:
        """Inputs that are missing or too old, in words; empty if all are there."""
        absent = [words_of(name, self._robot) for name in self._waiting if name not in self._newest_ns]
        if self._pose is None:
            absent.append("odometry")
        if self._pose is None or absent:
            return f"no {' and no '.join(absent)}"
        stamps_ns = {words_of(name, self._robot): stamp_ns for name, stamp_ns in self._newest_ns.items()}
        if old := self._too_old(stamps_ns | {"odometry": self._pose.stamp_ns}, now_ns):
            return old
        if self._picture_ns is None or self._clock.age_s(self._picture_ns, now_ns) > STALE_S:
            return f"no images of one time: {self._apart()}"
        return ""

    def _too_old(self, stamps_ns: Mapping[str, int], now_ns: int) -> str:
        """Messages that are too old by their newest stamps, with their ages, in words; empty if there are none."""
        ages = {words: self._clock.age_s(stamp_ns, now_ns) for words, stamp_ns in stamps_ns.items()}
        old = {words: age_s for words, age_s in ages.items() if age_s > STALE_S}
        if not old:
            return ""
        named = max(old, key=lambda words: old[words])
        arrived_ns = self._arrived_ns[named]
        if len(old) == len(self._waiting) > 1 and "odometry" not in old:
            named, arrived_ns = "images", max(self._arrived_ns[words] for words in old)
        if (now_ns - arrived_ns) / 1e9 > STALE_S:
            return f"no new {named}"
        return f"{named} are too old when they come, or the clocks of images and odometry differ"

    def _apart(self) -> str:
        """The image with the largest time difference to the first camera's, in words."""
        first_ns = self._newest_ns[RGB]
        apart_s = {
            name: min((abs(one.stamp_ns - first_ns) for one in waiting), default=abs(self._newest_ns[name] - first_ns))
            / 1e9
            for name, waiting in self._waiting.items()
        }
        worst = max(apart_s, key=lambda name: apart_s[name])
        return f"{words_of(worst, self._robot)} are {apart_s[worst]:.2f} s from the first camera's"

    def _check_clock(self, how: str) -> None:
        if how and self.started_ns is not None:
            self.end(TrialEnding.CLOCK, how)

    def _check_leap(self, before: OdometryMessage, now: OdometryMessage, passed_s: float) -> None:
        way_m = math.hypot(now.x_m - before.x_m, now.y_m - before.y_m)
        if self.started_ns is None:
            return
        if way_m > LEAP_M + 2 * self._robot.v_max_mps * passed_s:
            self.end(TrialEnding.LEAP, f"the odometry leapt by {way_m:.1f} m")
        turn_rad = abs(float(wrap_angle(now.yaw_rad - before.yaw_rad)))
        if turn_rad > LEAP_RAD + 2 * self._robot.w_max_radps * passed_s:
            self.end(TrialEnding.LEAP, f"the odometry's heading leapt by {turn_rad:.1f} rad")
        self.driven_m += way_m


def words_of(name: str, robot: RobotConfig) -> str:
    """Name of an image in messages; for a robot with several cameras it includes the camera's name."""
    what = "images" if kind_of(name) == RGB else "depths"
    return f"{what} of {camera_of(name) or robot.camera_name}" if robot.cameras else what


def limit_speeds(robot: RobotConfig, config: DriveConfig) -> RobotConfig:
    """The robot with the speed limits of a trial.

    Raises:
        ValueError: If the limits are not positive, or above the robot's.
    """
    for name in ("v_max_mps", "w_max_radps"):
        asked, most = getattr(config, name), getattr(robot, name)
        if not 0 < asked <= most:
            raise ValueError(f"{name} must be above 0 and at most {most:g}, what the policy learned, got {asked:g}.")
    backwards = max(robot.v_min_mps, -config.v_max_mps)
    return replace(robot, v_max_mps=config.v_max_mps, v_min_mps=backwards, w_max_radps=config.w_max_radps)
