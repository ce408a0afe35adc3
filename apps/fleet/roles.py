"""Roles in a fleet: those of a run's stages or one for all stages, and recorder and coordinator."""

from readygo.common.bus.identity import ALL, COORDINATOR, RECORDER
from readygo.common.messages import RunSpec


def places(spec: RunSpec, recorders: tuple[str, ...], workers: int, *, together: bool = False) -> list[tuple[str, str]]:
    """Role and name of every process of a local fleet.

    Args:
        spec: The run.
        recorders: Names of its recorders.
        workers: Processes of the role that does the last stage, which is the most work; every other role has one.
        together: True for `workers` processes that do all stages instead, for machines with few cores.
    """
    busiest = spec.stages[-1].role
    counts = {stage.role: workers if stage.role == busiest else 1 for stage in spec.stages}
    if together:
        counts = {ALL: workers}
    return [
        (COORDINATOR, COORDINATOR),
        *((RECORDER, name) for name in recorders),
        *((role, f"{role}{number}") for role, count in counts.items() for number in range(count)),
    ]
