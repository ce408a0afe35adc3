"""What a fleet of many workers would do: `python -m experiments.fleet.model [--workers 10 100 1000 10000]`.

A discrete-event model: workers that do all stages, one episode after the other, each on a separate core; a
coordinator and recorders that serve one request after the other in order of arrival. The times are measured ones: those
of the requests by `rates` (processor time, Zenoh not included), those of the stages by `readygo generate --json`
(`cpu_s`).
"""

import heapq
import json
import math
import random
from dataclasses import dataclass
from typing import Annotated

import tyro

from readygo.common.fleet.append import BATCH

COORDINATOR = -1
"""A station's number; those of recorders are 0, 1, ..."""
WORK = None
"""Used instead of a station's number: the step runs on the worker's core."""
SPREAD = 0.5
"""Work takes its mean time, more or less by up to this share."""
EVENTS_MAX = 3_000_000


@dataclass(frozen=True, kw_only=True)
class Times:
    """Mean times of a line [s], of 222 samples of 144x256 by default; `rates` and a run on the embedded scene."""

    plan_s: float = 0.35
    """The stages before the images, together."""
    sample_s: float = 0.0055
    """One image with all that belongs to it."""
    samples: int = 222
    """Samples per episode."""
    plan_stages: int = 3
    claim_s: float = 0.0004
    complete_s: float = 0.0008
    record_s: float = 0.0001
    """Each of expect, grant and done."""
    append_sample_s: float = 0.00028
    """The recorder's work for a sample."""


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What the model says of a fleet."""

    workers: int
    recorders: int
    samples_hz: float
    share_of_ideal: float
    """Samples per second as a share of what workers that never wait would make, 0..1."""
    coordinator_busy: float
    """Share of the time, 0..1."""
    recorder_busy: float
    """Share of the time that the busiest recorder is busy, 0..1."""
    claim_p99_s: float


Step = tuple[int | None, float, bool]
"""Where, for how long [s], and whether it is a claim; recorders are put in place by the worker."""
_RECORDER = 0


def episode_steps(times: Times) -> list[Step]:
    """What happens to an episode, in this order."""
    claim: Step = (COORDINATOR, times.claim_s, True)
    steps: list[Step] = []
    for _ in range(times.plan_stages):
        steps += [claim, (WORK, times.plan_s / times.plan_stages, False), (COORDINATOR, times.complete_s, False)]
    steps.append(claim)
    for first in range(0, times.samples, BATCH):
        count = min(BATCH, times.samples - first)
        steps += [(WORK, count * times.sample_s, False), (_RECORDER, count * times.append_sample_s, False)]
        steps += [(COORDINATOR, times.record_s, False)] if first == 0 else []
    return [*steps, (COORDINATOR, 2 * times.record_s, False), (COORDINATOR, times.complete_s, False)]


def predict(times: Times, workers: int, recorders: int = 1, *, cores: float = math.inf, seed: int = 0) -> Prediction:
    """Let a fleet work for some episodes per worker, of which the first are not counted.

    Args:
        times: Mean times.
        workers: Size of the fleet.
        recorders: Recorders.
        cores: Cores that the workers share, if there is not one for each of them.
        seed: Seed of the varying service times.
    """
    steps, rng = episode_steps(times), random.Random(seed)
    ideal_s = times.plan_s + times.samples * times.sample_s
    rounds = max(2, min(8, EVENTS_MAX // (workers * len(steps))))
    free_s = dict.fromkeys([COORDINATOR, *range(recorders)], 0.0)
    busy_s = dict.fromkeys(free_s, 0.0)
    waits_s: list[float] = []
    ends_s: list[float] = []
    events = [(rng.uniform(0.0, ideal_s), worker, 0) for worker in range(workers)]
    heapq.heapify(events)
    at_work: set[int] = set()
    while events:
        now_s, worker, number = heapq.heappop(events)
        station, service_s, is_claim = steps[number % len(steps)]
        at_work.discard(worker)
        if station is WORK:
            at_work.add(worker)
            slower = max(1.0, len(at_work) / cores)
            then_s = now_s + slower * service_s * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD)
        else:
            station = worker % recorders if station == _RECORDER else station
            then_s = free_s[station] = max(now_s, free_s[station]) + service_s
            busy_s[station] += service_s
            if is_claim:
                waits_s.append(then_s - now_s)
        if (number + 1) % len(steps) == 0:
            ends_s.append(then_s)
        if number + 1 < rounds * len(steps):
            heapq.heappush(events, (then_s, worker, number + 1))
    return _prediction(times, workers, recorders, ends_s, busy_s, waits_s)


def _prediction(
    times: Times, workers: int, recorders: int, ends_s: list[float], busy_s: dict[int, float], waits_s: list[float]
) -> Prediction:
    ends_s.sort()
    # While it fills and while it empties a fleet is not what it is in between.
    first, last = len(ends_s) // 4, 3 * len(ends_s) // 4
    samples_hz = (last - first) * times.samples / (ends_s[last] - ends_s[first])
    waits_s.sort()
    ideal_hz = workers * times.samples / (times.plan_s + times.samples * times.sample_s)
    # Busy as long as episodes pass at this rate.
    whole_s = len(ends_s) * times.samples / samples_hz
    return Prediction(
        workers=workers,
        recorders=recorders,
        samples_hz=round(samples_hz, 1),
        share_of_ideal=round(samples_hz / ideal_hz, 3),
        coordinator_busy=round(min(1.0, busy_s[COORDINATOR] / whole_s), 3),
        recorder_busy=round(min(1.0, max(busy_s[number] for number in range(recorders)) / whole_s), 3),
        claim_p99_s=round(waits_s[int(0.99 * len(waits_s))], 4),
    )


def main(
    times: Annotated[Times, tyro.conf.OmitArgPrefixes] = Times(),
    *,
    workers: tuple[int, ...] = (10, 100, 1000, 10_000),
    recorders: tuple[int, ...] = (1, 8),
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Predict.

    Args:
        times: Measured times.
        workers: Sizes of the fleet.
        recorders: Recorders.
        json_output: Print JSON.
    """
    found = [predict(times, size, count) for count in recorders for size in workers]
    if json_output:
        print(json.dumps([vars(prediction) for prediction in found]))
        return
    names = ("workers", "recorders", "samples/s", "of ideal", "coordinator", "recorder", "claim p99")
    print(" ".join(f"{name:>11}" for name in names))
    for row in found:
        cells = [row.workers, row.recorders, f"{row.samples_hz:.0f}", f"{row.share_of_ideal:.0%}"]
        cells += [f"{row.coordinator_busy:.0%}", f"{row.recorder_busy:.0%}", f"{row.claim_p99_s:.3f} s"]
        print(" ".join(f"{cell:>11}" for cell in cells))


if __name__ == "__main__":
    tyro.cli(main)
