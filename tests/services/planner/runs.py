"""Runs with known content: a robot that drives 4 m along x while people stand or walk."""

import numpy as np

from readygo.common.messages import HumanTrajectory, Outcome, RobotTrajectory, Scenario
from readygo.services.planner.expert.perception import PerceivedHuman
from readygo.services.planner.explain.journal import DrivenRun, Journal
from tests.services.planner.worlds import animate, key

STEPS = 80
Y_M = 4.6
X_M = np.linspace(-2.0, 2.0, STEPS)
WAY = np.column_stack([X_M, np.full(STEPS, Y_M)])


def make_scenario(*humans) -> Scenario:
    """People by their positions at every step."""
    return Scenario(
        episode=key(0),
        start_xyyaw=np.array([-2.0, Y_M, 0.0]),
        goal_xy_m=np.array([2.5, Y_M]),
        humans=tuple(
            HumanTrajectory(avatar="mia", encounter="crossing", speed_mps=1.0, xy_m=np.asarray(track, float))
            for track in humans
        ),
    )


def make_run(*humans, outcome=Outcome.SUCCESS, journal=None) -> DrivenRun:
    """A run along WAY."""
    scenario, zeros, off = make_scenario(*humans), np.zeros(STEPS), np.zeros(STEPS, np.bool_)
    trajectory = RobotTrajectory(
        outcome=outcome,
        xyyaw=np.column_stack([WAY, zeros]),
        actions=np.column_stack([np.full(STEPS, 1.0), zeros]),
        replanned=off,
        human_visible=off,
        human_distance_m=np.full(STEPS, np.inf),
        time_to_collision_s=np.full(STEPS, np.inf),
        expert_cost=zeros,
        replan_times_s=np.array([0.001]),
    )
    return DrivenRun(
        scenario=scenario,
        motions=animate(scenario),
        trajectory=trajectory,
        journal=journal or make_journal([WAY[k:] for k in range(STEPS)], searches=(0,)),
    )


def make_journal(paths, *, searches, seen=None) -> Journal:
    """A journal with the path in force at each step; `seen` says by step where the only human is perceived."""
    seen = seen or {}
    return Journal(
        paths_m=list(paths),
        perceived=[(perceived(*seen[k]),) if k in seen else () for k in range(len(paths))],
        searched=[k in searches for k in range(len(paths))],
    )


def perceived(x_m, y_m, *, seen=True) -> PerceivedHuman:
    """A human that is expected to go up by 2 m."""
    ahead_m = np.column_stack([np.full(40, x_m), y_m + np.linspace(0.05, 2.0, 40)])
    return PerceivedHuman(
        index=0, x_m=x_m, y_m=y_m, vx_mps=0.0, vy_mps=1.0, seen=seen, find_walks=lambda: (ahead_m[None], np.ones(1))
    )
