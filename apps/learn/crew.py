"""All processes of a run that learns: a fleet in every scene and one trainer."""

import threading
from collections import deque
from types import TracebackType

from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.roles import ALL, places
from readygo.apps.learn.cores import Split, shared_out
from readygo.apps.learn.plan import Place, Plan
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import RunError
from readygo.common.messages import CommittedEpisode, Driver, Outcome, StatusReply, topics

LATEST = 50
"""Episodes that policies drove last, over which their success rate is told."""


class Crew:
    """Starts, watches and ends the processes; they are gone when the block is left."""

    def __init__(self, plan: Plan, split: Split) -> None:
        """Open the bus; `start` starts the processes.

        Raises:
            BusError: If no endpoint can be opened.
        """
        self.status: dict[str, StatusReply] = {}
        """Of each scene's run, as it was told last."""
        self._plan, self._split = plan, split
        self._driven: deque[bool] = deque(maxlen=LATEST)
        self._endpoint = free_endpoint()
        self._router = Router(self._endpoint)
        self._fleets: dict[str, Fleet] = {}
        self._buses: list[ZenohBus] = []
        self._lock = threading.Lock()

    def __enter__(self) -> "Crew":
        for place in self._plan.places:
            bus = ZenohBus(self._endpoint, place.spec.run)
            self._buses.append(bus)
            bus.subscribe(topics.PROGRESS, lambda status, name=place.name: self.status.update({name: status}))
            bus.subscribe(topics.COMMITTED, self._note)
        return self
