import dataclasses

from experiments.fleet.model import Times, predict
from experiments.fleet.model_check import Measured, compared, measured_of, synthetic_row
from readygo.common.messages import StatusReply

TIMES = Times(plan_s=0.1, sample_s=0.01, samples=20, append_sample_s=0.001)


def told(episodes: int) -> StatusReply:
    """Of a run that takes 0.5 s of planning and 1 s of images of 10 samples for each episode."""
    return StatusReply(
        wanted=8,
        committed=episodes,
        samples=10 * episodes,
        waiting={},
        leased={},
        rejected={},
        requeued=0,
        cpu_s={"human-plan": 0.2 * episodes, "animate": 0.3 * episodes, "render": 1.0 * episodes},
        finished=episodes == 8,
    )


def test_middle_of_a_run_is_measured() -> None:
    # The first report of two, and of six or more, episodes.
    reports = [(0.0, 0), (5.0, 2), (6.0, 2), (9.0, 5), (11.0, 6), (30.0, 8)]
    found = measured_of([(time_s, told(episodes)) for time_s, episodes in reports], workers=2)
    assert (found.workers, found.samples_hz, found.samples) == (2, 40 / 6.0, 10)
    assert (round(found.cores, 6), round(found.plan_s, 6), round(found.sample_s, 6)) == (1.0, 0.5, 0.1)


def test_workers_that_share_cores_are_as_fast_as_the_cores() -> None:
    alone, shared = predict(TIMES, 2), predict(TIMES, 8, cores=2.0)
    assert 0.8 < shared.samples_hz / alone.samples_hz < 1.25
    measured = Measured(workers=8, samples_hz=shared.samples_hz, cores=2.0, plan_s=0.1, sample_s=0.01, samples=20)
    row = compared(TIMES, measured)
    assert (row["workers"], row["ratio"]) == ("8", 1.0)


def test_workers_that_sleep_take_no_cores() -> None:
    row = synthetic_row(dataclasses.replace(TIMES, append_sample_s=0.0), 50, 100.0)
    assert row["cores"] is None
    assert 0.9 < row["predicted"] / (50 * 40 / 11.0) < 1.1
