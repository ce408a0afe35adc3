"""An evaluation by a fleet: workers lease episodes, this process saves their records."""

import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from readygo.apps.fleet.access import how_to_join, join, open_router, reached_here, refusals_on_stderr
from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.token import given_token, new_token
from readygo.common.bus import Bus
from readygo.common.bus.identity import COORDINATOR
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.errors import RunError
from readygo.common.fleet.grants import Grants
from readygo.common.messages import EvaluationPlan, PolicyRef, RunSpec
from readygo.common.messages.stages import EVALUATE, EVALUATE_LINE
from readygo.runs.folder import RunFolder
from readygo.runs.identity import files_of, numeric_class, run_name
from readygo.runs.policy import policy_refs
from readygo.runs.world import World
from readygo.services import coordinator as coordination
from readygo.services.evaluator import Elsewhere, EvaluateRequest, Keeper, Report, Results
from readygo.services.evaluator import attach as attach_keeper

WORKERS_MAX = 256
KEEPER = "keeper"
"""Name of this process in messages to the coordinator."""
TICK_S = 0.1
"""Period of passing commits on and checking workers [s]."""
GRANT_TIMEOUT_S = 10.0


@dataclass(frozen=True, kw_only=True)
class EvaluationFleet:
    """Settings of an evaluation by a fleet."""

    spec: RunSpec
    """Spec of the world, from `fleet_spec`."""
    plan: EvaluationPlan
    request: EvaluateRequest
    results: Results
    """Folder that records are saved in."""
    workers: int
    """Number of worker processes on this machine."""
    listen: str = ""
    """Endpoint of the router, for further workers; empty takes a free loopback port."""
    certs: Path | None = None
    """Folder of certificates, for an endpoint tls/..."""
    report: Report = lambda _: None
    say: Callable[[str], None] = lambda _: None
    """Called with the command by which further workers join, if `listen` is given."""

    def __post_init__(self) -> None:
        if not 1 <= self.workers <= WORKERS_MAX:
            raise RunError(f"--workers must be 0..{WORKERS_MAX}, got {self.workers}.")


def fleet_spec(world: World, policy: Path | None) -> RunSpec:
    """The run spec of an evaluation, for its workers.

    Args:
        world: World of the evaluation.
        policy: Folder of the policy; None if none drives.
    """
    ref = None
    if policy is not None:
        files = policy_refs(policy)
        ref = PolicyRef(path=str(policy.resolve()), files=files, mix=1.0)
    metadata = {**world.spec.metadata, "numeric_class": numeric_class(world.config, ref)}
    spec = dataclasses.replace(world.spec, stages=EVALUATE_LINE, policy=ref, metadata=metadata)
    return dataclasses.replace(spec, run=run_name(spec))


def make_plan(
    request: EvaluateRequest, *, camera: str, lockstep: int, checkpoints: Path, method_hashes: dict[str, str]
) -> EvaluationPlan:
    """The evaluation's settings for its workers; arguments as the fields of `EvaluationPlan`."""
    return EvaluationPlan(
        tasks=tuple(task.value for task in request.tasks),
        methods=request.methods,
        control_hz=request.control_hz,
        camera=camera,
        lockstep=lockstep,
        checkpoints=str(checkpoints.resolve()),
        method_hashes=method_hashes,
    )


def by_fleet(fleet: EvaluationFleet) -> Elsewhere:
    """A function that lets a fleet drive the episodes of given indices over Zenoh.

    It raises RunError if they cannot be driven; saved records stay.
    """
    return partial(_drive_by_fleet, fleet)


def _drive_by_fleet(fleet: EvaluationFleet, indices: Sequence[int]) -> None:
    folder = RunFolder(fleet.results.folder)
    folder.check_other()
    run, certs, endpoint = fleet.spec.run, fleet.certs, fleet.listen or free_endpoint()
    token, here = "" if certs else given_token() or new_token(), reached_here(endpoint)
    with contextlib.ExitStack() as open_things, folder.lock():
        scratch = Path(open_things.enter_context(tempfile.TemporaryDirectory()))
        if certs:
            open_things.enter_context(refusals_on_stderr())
        router = open_router((KEEPER,), endpoint, certs=certs, token=token)
        open_things.callback(router.close)
        # A handler must not send requests on the thread that answers them: keeper and coordinator have separate buses.
        buses = [join(here, run, COORDINATOR, certs=certs, token=token) for _ in range(2)]
        for bus in buses:
            open_things.callback(bus.close)
        folder.save(fleet.spec, len(indices))
        open_things.enter_context(folder.reachable(here, token))
        served = open_things.enter_context(serving(fleet, indices, scratch, *buses))
        data = folder.path.resolve()
        processes = Fleet(connect=here, run=run, data=data, logs=folder.logs, token=token, certs=certs)
        open_things.callback(processes.stop)
        for number in range(min(fleet.workers, len(indices))):
            processes.add(EVALUATE.role, f"{EVALUATE.role}{number}")
        if fleet.listen:
            fleet.say(
                how_to_join(folder.state, EVALUATE.role, fleet.listen, f" --run {fleet.spec.run}", certs=fleet.certs)
            )
        while not served.tick():
            processes.check()
            time.sleep(TICK_S)


@dataclass(frozen=True, kw_only=True)
class Serving:
    """Coordinator and keeper, which answer the workers."""

    coordinator: coordination.Coordinator
    keeper: Keeper
    bus: Bus

    def tick(self) -> bool:
        """Pass commits on and free expired leases; call it a few times a second. True when all episodes are driven.

        Raises:
            RunError: If the evaluation failed or was cancelled; saved records stay.
        """
        self.keeper.grants.flush()
        coordination.tick(self.bus, self.coordinator)
        if self.coordinator.over and not self.coordinator.finished:
            raise RunError(
                f"{self.coordinator.failed or 'Cancelled.'} Finished episodes are kept: the same command resumes."
            )
        return self.coordinator.finished


@contextlib.contextmanager
def serving(
    fleet: EvaluationFleet, indices: Sequence[int], scratch: Path, coordinator_bus: Bus, keeper_bus: Bus
) -> Iterator[Serving]:
    """Answer the workers of an evaluation.

    Args:
        fleet: Settings of the evaluation.
        indices: Episodes with missing records.
        scratch: Empty folder for a temporary ledger of leases; the records alone say which episodes are done.
        coordinator_bus: Bus on which leases are given.
        keeper_bus: Bus on which records are received; within one process it may be the same.
    """
    spec = fleet.spec
    ledger = coordination.Ledger(scratch / "ledger.sqlite", spec.stages)
    ledger.assign(dict.fromkeys(indices, ""))
    config = dataclasses.replace(World(spec).config.coordinator, recorders=(KEEPER,), folders={})
    coordinator = coordination.Coordinator(
        spec=spec,
        wanted=len(indices),
        ledger=ledger,
        blobs=coordination.BlobStore(scratch / "blobs", files_of(spec)),
        config=config,
        set_aside=lambda index, reason, results: _give_up(coordinator, index, reason),
    )
    keeper = Keeper(
        plan=fleet.plan,
        request=fleet.request,
        results=fleet.results,
        grants=Grants(keeper_bus, KEEPER, GRANT_TIMEOUT_S),
        recorder=KEEPER,
        report=fleet.report,
        clock=World(spec).config.robot.clock,
    )
    coordination.attach(coordinator_bus, coordinator)
    attach_keeper(keeper_bus, keeper)
    try:
        yield Serving(coordinator=coordinator, keeper=keeper, bus=coordinator_bus)
    finally:
        ledger.close()


def _give_up(coordinator: coordination.Coordinator, index: int, reason: str) -> str:
    """End the evaluation with an error: a replacement of this episode would change the evaluation."""
    coordinator.failed = f"Episode {index} cannot be driven: {reason}."
    return ""
