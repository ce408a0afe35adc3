"""Robots of several scenes side by side, as one state simulation in which a policy learns."""

from collections.abc import Mapping, Sequence

import numpy as np

from readygo.common.arrays import AnyArray, Float64Array
from readygo.common.state_simulation.simulation import Ended, StateSimulation


class JoinedSimulation:
    """The robots of some simulations, in their order.

    Attributes:
        told: What the robots are told, shape (N, told_count).
        truth: What a critic is told, shape (N, truth_count).
        last: Results of the last decision.
    """

    def __init__(self, parts: Sequence[StateSimulation]) -> None:
        """Join simulations whose robots are told equally many numbers.

        Args:
            parts: One per scene.
        """
        self._parts = tuple(parts)
        self._ends = np.cumsum([len(part) for part in parts])
        self._collect()

    def __len__(self) -> int:
        return int(self._ends[-1])

    def begin_anywhere(self) -> None:
        """Put all robots into random episodes of their scenes."""
        for part in self._parts:
            part.begin_anywhere()
        self._collect()

    def advance(self, commands: Float64Array) -> Ended:
        """Let every robot follow a command, shape (N, 2), see `StateSimulation.advance`."""
        for part, of_part in zip(self._parts, np.split(commands, self._ends[:-1]), strict=True):
            part.advance(of_part)
        self._collect()
        return self.last

    def snapshot(self) -> dict[str, AnyArray]:
        """All that changes, by name: `restore` continues from it."""
        return {f"{k}.{name}": array for k, part in enumerate(self._parts) for name, array in part.snapshot().items()}

    def restore(self, arrays: Mapping[str, AnyArray]) -> None:
        """Continue from a snapshot of as many robots in the same banks."""
        for k, part in enumerate(self._parts):
            start = f"{k}."
            part.restore({name[len(start) :]: array for name, array in arrays.items() if name.startswith(start)})
        self._collect()

    def _collect(self) -> None:
        parts = self._parts
        self.told = np.concatenate([part.told for part in parts])
        self.truth = np.concatenate([part.truth for part in parts])
        self.last = Ended(*(np.concatenate(arrays) for arrays in zip(*(part.last for part in parts), strict=True)))
