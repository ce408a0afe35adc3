import pytest

from experiments.fleet.model import COORDINATOR, WORK, Times, episode_steps, predict

TIMES = Times(plan_s=0.1, sample_s=0.01, samples=20, append_sample_s=0.001)


def test_steps_of_an_episode_take_the_times_of_its_parts() -> None:
    steps = episode_steps(TIMES)
    assert sum(service_s for station, service_s, _ in steps if station is WORK) == pytest.approx(0.3)
    asked_s = 4 * (TIMES.claim_s + TIMES.complete_s) + 3 * TIMES.record_s
    assert sum(service_s for station, service_s, _ in steps if station == COORDINATOR) == pytest.approx(asked_s)
    assert sum(is_claim for *_, is_claim in steps) == 4


def test_few_workers_wait_for_nobody() -> None:
    found = predict(TIMES, 2)
    assert 0.85 < found.share_of_ideal <= 1.0
    assert found.coordinator_busy < 0.05


def test_one_recorder_saturates_first_and_more_of_them_leave_the_coordinator() -> None:
    one, many = predict(TIMES, 400), predict(TIMES, 400, recorders=40)
    assert one.samples_hz == pytest.approx(1.0 / TIMES.append_sample_s, rel=0.05)
    assert one.recorder_busy > 0.95
    asked_s = 4 * (TIMES.claim_s + TIMES.complete_s) + 3 * TIMES.record_s
    assert many.samples_hz == pytest.approx(TIMES.samples / asked_s, rel=0.05)
    assert many.coordinator_busy > 0.95
    assert many.claim_p99_s > predict(TIMES, 2).claim_p99_s
