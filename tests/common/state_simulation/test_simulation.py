import numpy as np
import pytest

from readygo.common.camera.view import in_view, view_of
from readygo.common.perception.noise import EXACT, PERCEIVED
from readygo.common.state_simulation.simulation import (
    HUMAN_COLLISION,
    OUTCOMES,
    RUNNING,
    STATIC_COLLISION,
    SUCCESS,
    RewardConfig,
    StateSimulation,
    StateSimulationConfig,
)
from readygo.common.state_simulation.tracks import tracker_numbers
from readygo.common.state_simulation.world import VIEW_RANGE_M
from tests.common.state_simulation.episodes import Drawn, draw, towards_path


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw(24)


def make(drawn: Drawn, count: int, noise=PERCEIVED, **more) -> StateSimulation:
    return StateSimulation(
        drawn.state_world, drawn.bank, tracker_numbers(noise, drawn.world.config.robot.clock), count, **more
    )


def check_agreement(drawn: Drawn) -> None:
    """Drive every episode in both simulations, and compare poses, outcomes, steps, and who is seen."""
    count, robot = len(drawn.bank), drawn.world.config.robot
    fast, rng = make(drawn, count, EXACT, knows_truth=False), np.random.default_rng(1)
    fast.begin(np.arange(count), np.ones(count, bool))
    exact = [drawn.simulation(k) for k in range(count)]
    view, sight, seen = view_of(robot.camera), drawn.world.scene.maps.sight, 0
    while (fast.last.outcome == RUNNING).any():
        commands, running = towards_path(fast.told, rng), np.flatnonzero(fast.last.outcome == RUNNING)
        fast.advance(commands, again=False)
        for k in running:
            one = exact[k]
            for _ in range(4):
                if one.outcome is None:
                    one.advance(*commands[k].tolist())
            assert fast.state[k].tolist() == [one.x_m, one.y_m, one.yaw_rad, one.v_mps, one.w_radps]
            assert (fast.last.length[k], OUTCOMES.get(fast.last.outcome[k])) == (one.step, one.outcome)
            if one.outcome is None:
                eye = robot.camera.eye(one.x_m, one.y_m, one.yaw_rad)
                for m, human in enumerate(one.human_xy_m.tolist()):
                    shown = in_view(eye, *human, view, VIEW_RANGE_M, drawn.world.config.episode.human_radius_m)
                    shown = shown and sight.sees(eye[0], eye[1], view.height_m, tuple(human))
                    assert (fast.tracks.seen_step[k, m] == one.step) == shown
                    seen += shown
    assert seen
    assert set(fast.last.outcome.tolist()) >= {SUCCESS, STATIC_COLLISION, HUMAN_COLLISION}


def test_robots_drive_see_and_end_as_in_the_simulation_of_the_data(drawn: Drawn) -> None:
    check_agreement(drawn)


@pytest.mark.slow
def test_thousand_episodes_agree() -> None:
    check_agreement(draw(1000))


def test_same_seed_repeats_every_bit_and_another_does_not(drawn: Drawn) -> None:
    def run(seed: int) -> np.ndarray:
        fast, rng = make(drawn, 8, seed=seed), np.random.default_rng(0)
        fast.begin_anywhere()
        for _ in range(60):
            fast.advance(towards_path(fast.told, rng))
        return fast.told.copy()

    assert np.array_equal(run(0), run(0))
    assert not np.array_equal(run(0), run(1))


def test_snapshot_continues_where_it_was_taken(drawn: Drawn) -> None:
    fast, other = make(drawn, 6, seed=0), make(drawn, 6, seed=5)
    fast.begin_anywhere()
    commands = np.tile([0.6, 0.3], (6, 1))
    for _ in range(20):
        fast.advance(commands)
    kept = fast.snapshot()
    other.restore(kept)
    for _ in range(30):
        fast.advance(commands)
        other.advance(commands)
    assert np.array_equal(fast.told, other.told)
    assert np.array_equal(fast.truth, other.truth)


def test_rewards_of_an_episode_are_its_progress_time_and_end(drawn: Drawn) -> None:
    reward = RewardConfig(turned=0.0, near=0.0, wall=0.0, impact=0.0)
    fast = make(drawn, 24, config=StateSimulationConfig(reward=reward))
    fast.begin(np.arange(24), np.zeros(24, bool))
    first, earned, rng = fast.remaining_m.copy(), np.zeros(24), np.random.default_rng(2)
    while (fast.last.outcome == RUNNING).any():
        earned += fast.advance(towards_path(fast.told, rng), again=False).reward
    ends = np.where(fast.last.outcome == SUCCESS, 2.0, np.where(fast.last.outcome == STATIC_COLLISION, -2.0, 0.0))
    expected = 0.2 * (first - fast.remaining_m) - 0.02 * 0.05 * fast.last.length + ends
    assert earned == pytest.approx(expected, abs=1e-3)


def test_reward_falls_beside_an_obstacle(drawn: Drawn) -> None:
    def drive(wall: float) -> tuple[np.ndarray, np.ndarray]:
        """Rewards and places of the decisions of 24 robots, until their episodes end."""
        config = StateSimulationConfig(reward=RewardConfig(wall=wall, wall_m=0.4))
        fast, rng, rewards, places = make(drawn, 24, config=config), np.random.default_rng(2), [], []
        fast.begin(np.arange(24), np.zeros(24, bool))
        for _ in range(40):
            running = fast.last.outcome == RUNNING
            earned = fast.advance(towards_path(fast.told, rng), again=False).reward
            rewards.append(earned[running].copy())
            places.append(fast.state[running, :2].copy())
        return np.concatenate(rewards), np.concatenate(places)

    rewards, places_xy_m = drive(-1.0)
    lost = drive(0.0)[0] - rewards
    robot_map, radius_m = drawn.world.scene.maps.robot, drawn.world.config.robot.radius_m
    i, j = np.nonzero(robot_map.occupied)
    frame = robot_map.frame
    blocked_xy_m = (frame.origin_x_m, frame.origin_y_m) + (np.stack([j, i], axis=1) + 0.5) * frame.resolution_m
    gaps_m = np.hypot(*(places_xy_m[:, None] - blocked_xy_m).transpose(2, 0, 1)).min(axis=1) - radius_m
    # Both are measured from the centres of cells.
    assert lost == pytest.approx(np.clip(1.0 - gaps_m / 0.4, 0.0, 1.0), abs=1.5 * frame.resolution_m / 0.4)
    assert lost.max() > 0.8
    assert (lost == 0).any()


def test_collision_with_a_person_costs_by_the_speed_of_the_robot(drawn: Drawn) -> None:
    def drive(impact: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rewards, outcomes and speeds after the last decision of 64 robots that drive, wait or drive backwards."""
        config = StateSimulationConfig(reward=RewardConfig(impact=impact), static_share=0.0)
        fast, earned = make(drawn, 64, config=config), np.zeros(64)
        fast.begin(np.arange(64) % len(fast.bank), np.ones(64, bool))
        for step in range(120):
            moving = np.where(np.arange(64) % 2 == 0, 0.8, 0.8 * (step < 10))
            earned += fast.advance(np.stack([moving, 0.0 * moving], axis=1), again=False).reward
        return earned, fast.last.outcome.copy(), fast.state[:, 3].copy()

    earned, outcome, v_mps = drive(-3.0)
    hit = outcome == HUMAN_COLLISION
    expected = np.where(hit, -3.0 * np.abs(v_mps), 0.0)
    assert earned - drive(0.0)[0] == pytest.approx(expected, abs=1e-5)
    assert (v_mps[hit] > 0.5).any()
    assert (v_mps[hit] == 0.0).any()


def test_robots_that_collided_with_people_try_again(drawn: Drawn) -> None:
    fast = make(drawn, 64, config=StateSimulationConfig(repeats=1.0, static_share=0.0))
    fast.begin_anywhere()
    before, collided = fast.episode.copy(), 0
    for _ in range(100):
        last = fast.advance(np.tile([0.8, 0.0], (64, 1)))
        hit = last.outcome == HUMAN_COLLISION
        assert np.array_equal(fast.episode[hit], before[hit])
        before, collided = fast.episode.copy(), collided + int(hit.sum())
    assert collided > 10


def test_ended_robots_begin_other_episodes_of_the_asked_share(drawn: Drawn) -> None:
    fast = make(drawn, 64, config=StateSimulationConfig(static_share=0.5))
    fast.begin_anywhere()
    dynamic = []
    for _ in range(120):
        last = fast.advance(np.tile([1.0, 0.4], (64, 1)))
        dynamic += last.dynamic[last.ended].tolist()
        assert (fast.step[last.ended] == 0).all()
    assert len(dynamic) > 200
    assert 0.3 < np.mean(dynamic) < 0.7
