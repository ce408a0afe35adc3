"""Division of the cores between recording and training."""

from dataclasses import dataclass

AHEAD_SAMPLES = 10_000
"""Number of samples that recording may be ahead of training, for example in the first minute."""


@dataclass(frozen=True)
class CoreSplit:
    """Numbers of cores for recording and for training."""

    collectors: int
    """Processes that do all stages of recording, one core each."""
    trainer_threads: int


def split_cores(cores: int, *, scenes: int, collect_hz: float, train_hz: float, reuse: float) -> CoreSplit:
    """The split at which training uses every recorded sample `reuse` times.

    k of n cores record k c samples a second, the others learn from (n - k) t: as many as k c reuse where
    k = n t / (t + reuse c). Both sides get a core at least, and every scene a collector.

    Args:
        cores: Number of cores, n.
        scenes: Number of scenes.
        collect_hz: Samples that one core records per second, c.
        train_hz: Samples that one core trains on per second, t.
        reuse: How often training uses each sample.
    """
    wanted = round(cores * train_hz / (train_hz + reuse * collect_hz))
    collectors = max(scenes, min(wanted, cores - 1), 1)
    return CoreSplit(collectors, max(1, cores - collectors))


def shared_out(collectors: int, scenes: int) -> list[int]:
    """Number of collectors of each scene: as even as possible, at least one each, or none at all."""
    if not collectors:
        return [0] * scenes
    return [max(1, collectors // scenes + (number < collectors % scenes)) for number in range(scenes)]


def is_ahead(learned: int, recorded: int, reuse: float) -> bool:
    """True while training keeps up with recording, so that more samples are needed.

    Cores cannot be divided, and on a shared machine collectors may get more processor time than the trainer: samples
    that training cannot use `reuse` times only take time from it.

    Args:
        learned: Samples that training has used, repeats counted.
        recorded: Samples with an image in the shards.
        reuse: How often training uses each sample.
    """
    return learned >= reuse * (recorded - AHEAD_SAMPLES)
