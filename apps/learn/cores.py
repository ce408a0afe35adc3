"""How many cores collect and how many learn."""

import os
from dataclasses import dataclass

AHEAD_SAMPLES = 10_000
"""Samples that may be recorded before they are learned from: those of the first minute, among others."""


@dataclass(frozen=True)
class Split:
    """Cores of a machine between collecting and learning."""

    collectors: int
    """Processes that do all stages of the line, one core each."""
    trainer_threads: int


def split_cores(cores: int, *, scenes: int, collect_hz: float, train_hz: float, reuse: float) -> Split:
    """The split at which every recorded sample is learned from `reuse` times.

    k of n cores record k c samples a second, the others learn from (n - k) t: as many as k c reuse where
    k = n t / (t + reuse c). Both sides get a core at least, and every scene a collector.

    Args:
        cores: Cores that there are, n.
        scenes: Scenes that are recorded in.
        collect_hz: Samples that one core records per second, c.
        train_hz: Samples that one core learns from per second, t.
        reuse: How often each sample is to be learned from.
    """
    wanted = round(cores * train_hz / (train_hz + reuse * collect_hz))
    collectors = max(scenes, min(wanted, cores - 1), 1)
    return Split(collectors, max(1, cores - collectors))


def shared_out(collectors: int, scenes: int) -> list[int]:
    """Collectors of each scene: as even as it goes, one at least, or none at all."""
    if not collectors:
        return [0] * scenes
    return [max(1, collectors // scenes + (number < collectors % scenes)) for number in range(scenes)]


def is_ahead(learned: int, recorded: int, reuse: float) -> bool:
    """True while training keeps up with what is recorded, so that more is wanted.

    Cores are whole, and on a machine that others use too a collector may get more of it than the trainer: what is
    recorded beyond its `reuse` only takes time from training.

    Args:
        learned: Samples that were learned from, repeats counted.
        recorded: Samples with an image in the shards.
        reuse: How often each sample is to be learned from.
    """
    return learned >= reuse * (recorded - AHEAD_SAMPLES)


def cores_here() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
