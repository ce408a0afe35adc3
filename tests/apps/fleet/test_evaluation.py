"""An evaluation that workers drive: the same records, however many there are and whatever becomes of them."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from readygo.apps.fleet.evaluation import EvaluationFleet, Serving, by_fleet, fleet_spec, make_plan, serving
from readygo.common.bus import Bus, InProcessBus
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import RunError
from readygo.common.fleet import Worker, claim_any
from readygo.common.messages import ClaimStatus, Split
from readygo.runs.config import RunConfig, with_run_keys
from readygo.runs.evaluation import evaluation_world, make_evaluator, make_request
from readygo.runs.stages import stage_works
from readygo.runs.world import World
from readygo.services.evaluator import EvaluateReply, Evaluator, Results, handle_evaluate, open_results

METHODS = ("straight-line", "social-force")
REQUEST = make_request(3, ("static", "dynamic"), METHODS, Split.VAL, 0)
"""Not of the default split: workers draw the episodes of the request's."""


@pytest.fixture(scope="module")
def world() -> World:
    config = dataclasses.replace(RunConfig(), episode=EpisodeConfig(time_limit_s=1.0))
    return evaluation_world("embedded", config, avatars=None, seed=0, split=REQUEST.split)


@pytest.fixture(scope="module")
def evaluator(world: World) -> Evaluator:
    return make_evaluator(world)


@pytest.fixture
def here(evaluator: Evaluator, tmp_path: Path) -> tuple[EvaluateReply, Path]:
    """The evaluation in this process, and its folder."""
    with open_results(tmp_path / "here", {}) as results:
        return handle_evaluate(evaluator, REQUEST, results=results), tmp_path / "here"


def fleet_of(world: World, results: Results, workers: int = 1) -> EvaluationFleet:
    plan = make_plan(REQUEST, camera="policy", lockstep=8, checkpoints=Path("none"), method_hashes={})
    return EvaluationFleet(spec=fleet_spec(world, None), plan=plan, request=REQUEST, results=results, workers=workers)


@contextmanager
def served(fleet: EvaluationFleet, indices: Sequence[int], scratch: Path) -> Iterator[tuple[Bus, Serving, Worker]]:
    """Coordinator and keeper within this process, and a worker."""
    scratch.mkdir()
    bus = InProcessBus()
    with serving(fleet, indices, scratch, bus, bus) as answering:
        works = stage_works(World(fleet.spec, bus), bus, "evaluator")
        yield bus, answering, Worker(name="evaluator0", numeric_class=_class(fleet), works=works)


def _class(fleet: EvaluationFleet) -> str:
    return str(fleet.spec.metadata["numeric_class"])


def same_lines(one: Path, other: Path) -> bool:
    names = ("episodes.jsonl", "trajectories.jsonl")
    return all(
        sorted((one / n).read_text().splitlines()) == sorted((other / n).read_text().splitlines()) for n in names
    )


def test_workers_give_the_same_records_in_one_reply(world, evaluator, here, tmp_path: Path) -> None:
    asked = []
    with open_results(tmp_path / "there", {}) as results:

        def elsewhere(indices: Sequence[int]) -> None:
            asked.append(list(indices))
            with served(fleet_of(world, results), indices, tmp_path / "scratch") as (bus, answering, worker):
                while claim_any(bus, worker) is not ClaimStatus.DONE:
                    answering.tick()

        reply = handle_evaluate(evaluator, REQUEST, results=results, elsewhere=elsewhere)
    assert reply.records == here[0].records
    assert reply.summaries == here[0].summaries
    assert asked == [sorted({record.episode.index for record in reply.records})]
    assert same_lines(tmp_path / "there", here[1])


def test_lost_worker_costs_no_record_and_doubles_none(world, evaluator, here, tmp_path: Path) -> None:
    with open_results(tmp_path / "there", {}) as results:
        keep: Callable[..., None] = results.keep

        def keep_and_die(record, trajectory) -> None:
            keep(record, trajectory)
            if len(results.records) == 3:
                raise KeyboardInterrupt

        results.keep = keep_and_die  # type: ignore[method-assign]
        indices = sorted({record.episode.index for record in here[0].records})
        with served(fleet_of(world, results), indices, tmp_path / "scratch") as (bus, answering, worker):
            with pytest.raises(KeyboardInterrupt):
                claim_any(bus, worker)
            answering.coordinator.ledger.requeue_all()
            while claim_any(bus, worker) is not ClaimStatus.DONE:
                answering.tick()
            assert answering.tick()
    assert same_lines(tmp_path / "there", here[1])


def test_episode_that_nobody_can_drive_ends_the_evaluation_with_its_reason(world, tmp_path: Path) -> None:
    with open_results(tmp_path / "there", {}) as results:

        def full(record, trajectory) -> None:
            raise RunError("the disk is full")

        results.keep = full  # type: ignore[method-assign]
        with served(fleet_of(world, results), [0], tmp_path / "scratch") as (bus, answering, worker):
            while claim_any(bus, worker) is not ClaimStatus.DONE:
                pass
            with pytest.raises(RunError, match=r"Episode 0 cannot be driven: .*the disk is full.*the same command"):
                answering.tick()


def test_folders_of_a_runs_recorders_are_no_concern_of_an_evaluation(world, tmp_path: Path) -> None:
    keys = {"coordinator": {"recorders": ["rec0", "east"], "folders": {"east": str(tmp_path / "disk")}}}
    with open_results(tmp_path / "there", {}) as results:
        fleet = fleet_of(World(with_run_keys(world.spec, keys)), results)
        with served(fleet, [0], tmp_path / "scratch") as (_, answering, _):
            assert answering.coordinator.recorders == ("keeper",)


def test_number_of_workers_and_folders_of_data_are_checked(world, tmp_path: Path) -> None:
    (tmp_path / "shard-rec0-00000.mcap").write_bytes(b"")
    with open_results(tmp_path, {}) as results:
        with pytest.raises(RunError, match="--workers must be"):
            fleet_of(world, results, workers=1000)
        with pytest.raises(RunError, match="holds recorded data"):
            by_fleet(fleet_of(world, results))([0])
