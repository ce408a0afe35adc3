"""The model of a fleet beside real ones: `python -m experiments.fleet.model_check [--json]`.

Real runs of the embedded scene with one to eight processes that do all stages, and 200 synthetic workers, which sleep
instead of working, with a real coordinator and a real recorder. The model is fed with the times of the requests as
`rates` measures them, with the processor time that the stages of each run took, and with the cores that its workers
were given: other work on the machine takes some. Measured is between a quarter and three quarters of a run.
"""

import dataclasses
import json
import multiprocessing
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import tyro

from experiments.fleet.model import Times, predict
from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.run import CHECK_S, record
from readygo.apps.fleet.token import new_token
from readygo.benchmarks.fleet.chaos import SETTINGS
from readygo.benchmarks.fleet.rates import synthetic_spec, time_coordinator
from readygo.benchmarks.rasterizer.render import machine
from readygo.benchmarks.recording.dataset import make_image, make_requests
from readygo.common.bus.identity import ALL, COORDINATOR, RECORDER
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.fleet import Inputs, StageResult, Worker, append_episode, pull
from readygo.common.messages import ClaimReply, Split, StatusReply, topics
from readygo.runs.config import load_run_config, resolved_sections
from readygo.runs.folder import RunFolder
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec

PROCESSES = 4
"""Processes that run the synthetic workers, an equal share each."""
RESULT = bytes(9000)
SYNTHETIC = Times(plan_s=3.0, sample_s=0.2, samples=40)
"""Times of a synthetic worker: 11 s per episode."""
Told = tuple[float, StatusReply]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Measured:
    """A fleet between a quarter and three quarters of its run."""

    workers: int
    samples_hz: float
    cores: float
    """Cores that the fleet's workers took."""
    plan_s: float
    """Processor time of the stages before the images, for each episode."""
    sample_s: float
    """Processor time of the images, for each sample [s]."""
    samples: int
    """Samples per episode."""


def main(
    *,
    processes: tuple[int, ...] = (1, 2, 4, 8),
    episodes: int = 24,
    synthetic: int = 200,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure and predict.

    Args:
        processes: Sizes of the real fleets.
        episodes: Episodes of each.
        synthetic: Synthetic workers; 0 leaves them out.
        json_output: Print JSON.
    """
    with tempfile.TemporaryDirectory() as folder:
        times = request_times(Path(folder))
        rows = [compared(times, real_run(Path(folder) / f"run{count}", count, episodes)) for count in processes]
        if synthetic:
            measured_hz = synthetic_run(Path(folder) / "synthetic", synthetic)
            rows.append(synthetic_row(times, synthetic, measured_hz))
    result = {"machine": machine(), "times": dataclasses.asdict(times), "rows": rows}
    if json_output:
        print(json.dumps(result))
        return
    print(f"{'workers':>10} {'cores':>6} {'measured/s':>11} {'predicted/s':>11} {'ratio':>6}")
    for row in rows:
        cores, ratio = row["cores"] or "", row["ratio"]
        print(f"{row['workers']:>10} {cores:>6} {row['measured']:>11} {row['predicted']:>11} {ratio:>6}")


def request_times(folder: Path) -> Times:
    """What the coordinator takes for each request on this machine."""
    calls = time_coordinator(folder, 200)
    mean = {name: statistics.fmean(values) for name, values in calls.items()}
    return Times(claim_s=mean["claim"], complete_s=mean["complete"], record_s=mean["record"])


def compared(times: Times, measured: Measured) -> dict[str, Any]:
    """A row: what was measured, and what the model says of such a fleet."""
    own = {name: getattr(measured, name) for name in ("plan_s", "sample_s", "samples")}
    fed = dataclasses.replace(times, **own)
    found = predict(fed, measured.workers, cores=measured.cores)
    return _row(str(measured.workers), round(measured.cores, 2), measured.samples_hz, found.samples_hz)


def synthetic_row(times: Times, workers: int, measured_hz: float) -> dict[str, Any]:
    """A row for synthetic workers, which use no cores."""
    slept = {name: getattr(SYNTHETIC, name) for name in ("plan_s", "sample_s", "samples")}
    found = predict(dataclasses.replace(times, **slept), workers)
    return _row(f"{workers} asleep", None, measured_hz, found.samples_hz)


def _row(workers: str, cores: float | None, measured_hz: float, predicted_hz: float) -> dict[str, Any]:
    ratio = round(predicted_hz / measured_hz, 2)
    return {
        "workers": workers,
        "cores": cores,
        "measured": round(measured_hz, 1),
        "predicted": round(predicted_hz, 1),
        "ratio": ratio,
    }


def real_run(folder: Path, workers: int, episodes: int) -> Measured:
    """Record small images of the embedded scene by processes that do all stages."""
    folder.mkdir()
    (folder / "settings.toml").write_text(SETTINGS.replace('["rec0", "rec1", "rec2"]', '["rec0"]'))
    config = load_run_config(folder / "settings.toml")
    spec = make_spec(open_scene("embedded"), None, config, seed=0, split=Split.TRAIN, static=False)
    told: list[Told] = []
    record(
        spec,
        folder / "data",
        episodes=episodes,
        workers=workers,
        together=True,
        show=lambda status: told.append((time.monotonic(), status)),
    )
    return measured_of(told, workers)


def measured_of(told: list[Told], workers: int) -> Measured:
    """What the reports of a run say of its middle."""
    (begin_s, before), (end_s, after) = middle(told)
    spent = {stage: after.cpu_s[stage] - before.cpu_s.get(stage, 0.0) for stage in after.cpu_s}
    samples, episodes = after.samples - before.samples, after.committed - before.committed
    plan_s = sum(seconds for stage, seconds in spent.items() if stage != "render")
    return Measured(
        workers=workers,
        samples_hz=samples / (end_s - begin_s),
        cores=sum(spent.values()) / (end_s - begin_s),
        plan_s=plan_s / episodes,
        sample_s=spent["render"] / samples,
        samples=round(samples / episodes),
    )


def middle(told: list[Told]) -> tuple[Told, Told]:
    """The first reports that a quarter, and three quarters, of the episodes are durable."""
    firsts = [later for earlier, later in pairwise(told) if later[1].committed > earlier[1].committed]
    first, last = (
        next(report for report in firsts if report[1].committed >= share * report[1].wanted) for share in (0.25, 0.75)
    )
    return first, last


def synthetic_run(folder: Path, workers: int) -> float:
    """Samples/s of workers that sleep, at a real coordinator and a real recorder."""
    spec = dataclasses.replace(synthetic_spec(), config=resolved_sections(load_run_config(None)))
    run = RunFolder(folder)
    told: list[Told] = []
    over = threading.Event()

    def hear(status: StatusReply) -> None:
        told.append((time.monotonic(), status))
        if status.finished or status.failed:
            over.set()

    with fleet_of(run, spec, 4 * workers) as (fleet, endpoint, token), sleepers(endpoint, token, workers):
        bus = ZenohBus(endpoint, spec.run, token)
        bus.subscribe(topics.PROGRESS, hear)
        while not over.wait(CHECK_S):
            fleet.check()
        bus.close()
    (begin_s, before), (end_s, after) = middle(told)
    return (after.samples - before.samples) / (end_s - begin_s)


@contextmanager
def fleet_of(run: RunFolder, spec: Any, episodes: int) -> Iterator[tuple[Fleet, str, str]]:
    """A router, a coordinator and a recorder."""
    endpoint, token = free_endpoint(), new_token()
    with ExitStack() as opened, run.lock():
        run.save(spec, episodes)
        opened.callback(Router(endpoint, token).close)
        fleet = Fleet(connect=endpoint, run=spec.run, data=run.path.resolve(), logs=run.logs, token=token)
        opened.callback(fleet.stop)
        fleet.add(COORDINATOR, COORDINATOR)
        fleet.add(RECORDER, "rec0")
        yield fleet, endpoint, token


@contextmanager
def sleepers(endpoint: str, token: str, workers: int) -> Iterator[None]:
    """Workers that sleep, in a few processes."""
    context = multiprocessing.get_context("spawn")
    names = [[f"w{number}" for number in range(workers)][part::PROCESSES] for part in range(PROCESSES)]
    processes = [context.Process(target=sleep_all, args=(endpoint, token, part), daemon=True) for part in names]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.terminate()
            process.join()


def sleep_all(endpoint: str, token: str, names: list[str]) -> None:
    """Be some of them, a thread each."""
    images = [make_image(number) for number in range(4)]
    threads = [threading.Thread(target=_sleep_one, args=(endpoint, token, name, images)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _sleep_one(endpoint: str, token: str, name: str, images: list[bytes]) -> None:
    spec = synthetic_spec()
    bus = ZenohBus(endpoint, spec.run, token)
    plan, draw = partial(_plan, SYNTHETIC.plan_s / SYNTHETIC.plan_stages), partial(_draw, bus, images)
    works = {stage: draw if stage.records else plan for stage in reversed(spec.stages)}
    session = bus.announce(ALL, name)
    worker = Worker(name=name, numeric_class="none", works=works, role=ALL, session=session)
    pull(bus, worker, leave=lambda: False)
    bus.close()


def _plan(seconds: float, claim: ClaimReply, inputs: Inputs) -> StageResult:
    time.sleep(seconds)
    return StageResult(result=RESULT)


def _draw(bus: ZenohBus, images: list[bytes], claim: ClaimReply, inputs: Inputs) -> None:
    assert claim.episode is not None
    requests = make_requests(claim.episode.index, images)
    samples = [sample for request in requests for sample in request.samples][: SYNTHETIC.samples]
    header = dataclasses.replace(requests[0].header, sample_count=SYNTHETIC.samples)

    def slowly() -> Iterator[Any]:
        for sample in samples:
            time.sleep(SYNTHETIC.sample_s)
            yield sample

    append_episode(bus, claim, header, slowly())


if __name__ == "__main__":
    tyro.cli(main)
