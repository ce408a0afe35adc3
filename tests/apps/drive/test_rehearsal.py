import numpy as np

from readygo.apps.drive.calibration import Rectifier
from readygo.apps.drive.messages import GoalMessage
from readygo.apps.drive.pilot import DriveConfig, Pilot, TrialEnding
from readygo.apps.drive.rehearsal import simulate_drive
from readygo.apps.drive.simulated import Manners
from readygo.common.messages import Outcome
from tests.apps.drive.conftest import CAMERA, FakePolicy, open_ground


def run(policy=None, **manners):
    policy = policy or FakePolicy((1.0, 0.0))
    config = DriveConfig(v_max_mps=1.0, w_max_radps=1.2, goal_in_start_frame=False)
    pilot = Pilot(policy, {"": Rectifier(CAMERA, CAMERA)}, config, GoalMessage(x_m=2.0, y_m=0.0))
    simulation, asked = open_ground(), []

    def look(one):
        asked.append(one.step)
        return {"rgb": np.zeros((8, 10, 3), np.uint8)}

    plain = {"latency_s": 0.0, "jitter_s": 0.0, "drop_share": 0.0}
    outcome = simulate_drive(pilot, simulation, look, Manners(**{**plain, **manners}), np.random.default_rng(0))
    return outcome, simulation, pilot, asked


def test_without_latency_a_decision_counts_from_the_step_of_its_image():
    outcome, simulation, pilot, asked = run()
    assert outcome is Outcome.SUCCESS
    assert pilot.ending in (None, TrialEnding.GOAL)
    assert asked == list(range(simulation.step))
    # 0.05 m/s more at every step until 1 m/s: the circle around the goal is 1 m away.
    ways = np.cumsum(0.05 * np.minimum(0.05 * np.arange(1, 50), 1.0))
    assert simulation.step == 1 + int(np.argmax(ways >= 1.0 - 1e-9))


def test_slow_and_lossy_cameras_give_fewer_images_and_the_same_end():
    slow = run(camera_hz=5.0)
    assert slow[0] is Outcome.SUCCESS
    assert all(step % 4 == 0 for step in slow[3])
    lossy = run(drop_share=0.5, latency_s=0.1, jitter_s=0.02)
    assert lossy[0] is Outcome.SUCCESS
    assert len(lossy[2]._policy.seen_ns) < 0.8 * lossy[1].step


def test_images_that_are_too_old_move_no_robot():
    outcome, simulation, pilot, _ = run(latency_s=0.5)
    assert outcome is Outcome.TIMEOUT
    assert (simulation.x_m, pilot.started_ns) == (0.0, None)
