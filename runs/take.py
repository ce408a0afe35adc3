"""Replay of one episode in this process: planned, animated and driven as in a run, with the planner's journal."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

from readygo.common.avatars import Avatar
from readygo.common.errors import RunError
from readygo.common.messages import AnimateRequest, EpisodeKey, HumanPlanRequest, Outcome, Scenario
from readygo.common.policy import Policy
from readygo.common.policy.driver import PolicyDriver
from readygo.runs.config import RunConfig
from readygo.services.animator import Animator, handle_animate
from readygo.services.planner import (
    DrivenRun,
    HumanPlanner,
    PlanningMaps,
    RobotPlanner,
    ScenarioFile,
    drive,
    handle_human_plan,
    run_beside_expert,
    run_with_journal,
)
from readygo.services.renderer import LiveCamera, Renderer


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """One replayed episode, up to its rejection if it was rejected."""

    scenario: Scenario
    run: DrivenRun | None
    """The driven run; None if the humans could not be animated."""
    rejected: str
    """Reason why `readygo generate` rejects the episode; empty if it does not."""
    drive_ms: float
    """CPU time of the expert's whole run [ms]; 0 for any other driver."""


class Takes:
    """Replays episodes in one scene."""

    def __init__(
        self,
        maps: PlanningMaps,
        avatars: Mapping[str, Avatar],
        config: RunConfig,
        scenarios: ScenarioFile | None = None,
    ) -> None:
        """Prepare planners and animator.

        Args:
            maps: Maps of a scene, or a single map.
            avatars: Avatars by name; may be empty for episodes without humans.
            config: All settings.
            scenarios: Scenarios to play instead of drawn ones.
        """
        self.robot_planner = RobotPlanner(maps, avatars, config.robot, config.episode, config.expert)
        self._human_planner = HumanPlanner(
            maps,
            sorted(avatars),
            config.robot,
            config.episode,
            config.human_planner,
            scenarios=scenarios,
            make_expert=self.robot_planner.expert,
        )
        rate_hz = config.robot.clock.rate_hz
        self._animator = Animator(avatars, maps.floor, config.animator, obstacles=maps.human, rate_hz=rate_hz)

    def take(self, episode: EpisodeKey, *, static: bool, policy: tuple[PolicyDriver, LiveCamera] | None = None) -> Take:
        """Draw the scenario, animate the humans, and drive.

        Args:
            episode: Key of the episode.
            static: True leaves the humans out.
            policy: Driver and camera from `policy_driver`, for a policy instead of the expert.

        Raises:
            RunError: If this index has no scenario.
        """
        drawn = handle_human_plan(self._human_planner, HumanPlanRequest(episode=episode, static=static))
        if drawn.scenario is None:
            raise RunError(f"Episode {episode.episode_id} has no scenario: {drawn.rejected}. Ask for another --index.")
        animated = handle_animate(self._animator, AnimateRequest(scenario=drawn.scenario))
        if animated.motions is None:
            return Take(scenario=drawn.scenario, run=None, rejected=animated.rejected, drive_ms=0.0)
        if policy is not None:
            driver, camera = policy
            run = run_beside_expert(
                self.robot_planner, drawn.scenario, animated.motions, driver, "policy", observers=[camera]
            )
            return Take(scenario=drawn.scenario, run=run, rejected="", drive_ms=0.0)
        # Loads the compiled code first, whose time must not count as the planner's.
        drive(self.robot_planner, drawn.scenario, animated.motions)
        begin_s = time.thread_time()
        run = run_with_journal(self.robot_planner, drawn.scenario, animated.motions)
        drive_ms = 1e3 * (time.thread_time() - begin_s)
        outcome = run.trajectory.outcome
        rejected = "" if outcome is Outcome.SUCCESS else outcome.value
        return Take(scenario=drawn.scenario, run=run, rejected=rejected, drive_ms=drive_ms)


def policy_driver(policy: Policy, renderer: Renderer) -> tuple[PolicyDriver, LiveCamera]:
    """A policy's driver for one episode, and the camera that renders its images.

    Args:
        policy: Policy that drives.
        renderer: Renderer of the scene, with the policy's camera.
    """
    camera = LiveCamera(renderer, policy.spec.images)
    return PolicyDriver(policy, camera, renderer.robot.clock.control_every), camera
