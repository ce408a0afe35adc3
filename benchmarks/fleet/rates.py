"""What coordinator and recorder can carry: `python -m readygo.benchmarks.fleet.rates [--episodes 2000] [--json]`.

One process takes episodes through the line by the real handlers, ledger on disk, messages decoded and encoded as a
server does it; the results between the stages have the sizes of real ones. Times are processor time of the thread, so
other work on the machine does not count, nor does Zenoh, nor waiting for the disk; with fsync the recorder is timed by
the wall.
"""

import json
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from readygo.benchmarks.rasterizer.render import machine
from readygo.benchmarks.recording.dataset import make_image, make_requests, record
from readygo.common.messages import (
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    DoneRequest,
    ExpectRequest,
    GrantRequest,
    RunSpec,
    Split,
    Stage,
    Verdict,
    decode,
    encode,
)
from readygo.services.coordinator import BlobStore, Coordinator, CoordinatorConfig, Ledger, handlers

RESULT_BYTES = {"human-plan": 9_000, "animate": 160_000, "robot-plan": 14_000}
"""Sizes of the stages' results for the embedded scene with two humans [bytes]."""
SHARE_SAMPLES = 10
INGEST_EPISODES = 10


def main(*, episodes: int = 2000, json_output: Annotated[bool, tyro.conf.arg(name="json")] = False) -> None:
    """Measure.

    Args:
        episodes: Episodes that pass through the coordinator.
        json_output: Print JSON.
    """
    with tempfile.TemporaryDirectory() as folder:
        rates = {**coordinator_rates(time_coordinator(Path(folder), episodes)), **recorder_rates(Path(folder))}
    result = {"machine": machine(), "episodes": episodes, **rates}
    print(json.dumps(result) if json_output else "\n".join(f"{name:28} {value}" for name, value in result.items()))


def time_coordinator(folder: Path, episodes: int) -> dict[str, list[float]]:
    """Take episodes through the line, a stage after the other; processor time of every call, by what it asks [s]."""
    spec = synthetic_spec()
    coordinator = Coordinator(
        spec=spec,
        wanted=episodes,
        ledger=Ledger(folder / "ledger.sqlite", spec.stages),
        blobs=BlobStore(folder / "blobs"),
        config=CoordinatorConfig(plan_ahead=episodes + 1),
    )
    times: dict[str, list[float]] = {}

    def ask(name: str, reply_type: type[Any], handler: Callable[[Any], Any], request: Any) -> Any:
        payload, request_type = encode(request), type(request)
        begin_s = time.thread_time()
        reply = encode(handler(decode(request_type, payload)))
        times.setdefault(name, []).append(time.thread_time() - begin_s)
        return decode(reply_type, reply)

    def claim(stage: Stage) -> ClaimReply:
        handler = partial(handlers.handle_claim, coordinator, stage)
        lease: ClaimReply = ask("claim", ClaimReply, handler, ClaimRequest(worker="w", numeric_class="any"))
        return lease

    for stage in spec.stages[:-1]:
        for number in range(episodes):
            _complete(coordinator, stage, claim(stage), number, ask)
    for _ in range(episodes):
        _record(coordinator, claim(spec.stages[-1]), ask)
    assert coordinator.finished
    coordinator.ledger.close()
    return times


def _complete(coordinator: Coordinator, stage: Stage, lease: ClaimReply, number: int, ask: Callable[..., Any]) -> None:
    assert lease.episode is not None
    result = number.to_bytes(8, "little") * (RESULT_BYTES[stage.name] // 8)
    request = CompleteRequest(
        worker="w", index=lease.episode.index, attempt=lease.attempt, result=result, lease=lease.lease
    )
    ask("complete", Verdict, lambda asked: handlers.handle_complete(coordinator, stage, asked), request)


def _record(coordinator: Coordinator, lease: ClaimReply, ask: Callable[..., Any]) -> None:
    """What recorder and renderer ask until an episode is durable."""
    assert lease.episode is not None
    recorder, index, attempt, stage = lease.recorder, lease.episode.index, lease.attempt, coordinator.spec.stages[-1]
    done = DoneRequest(recorder=recorder, index=index, attempt=attempt, shard="shard-rec0-00000.mcap", sample_count=222)
    for handler, request in (
        (
            handlers.handle_expect,
            ExpectRequest(recorder=recorder, episode=lease.episode, attempt=attempt, lease=lease.lease),
        ),
        (handlers.handle_grant, GrantRequest(recorder=recorder, index=index, attempt=attempt)),
        (handlers.handle_done, done),
    ):
        ask("record", Verdict, lambda asked, handler=handler: handler(coordinator, asked), request)
    request = CompleteRequest(worker="w", index=index, attempt=attempt, lease=lease.lease)
    ask("complete", Verdict, lambda asked: handlers.handle_complete(coordinator, stage, asked), request)


def coordinator_rates(calls: dict[str, list[float]]) -> dict[str, float]:
    """Rates and percentiles of the calls."""
    ms = {name: [1000.0 * value for value in values] for name, values in calls.items()}
    completion_s = statistics.fmean(calls["claim"]) + statistics.fmean(calls["complete"])
    episode_s = sum(sum(values) for values in calls.values()) / (len(calls["record"]) / 3)
    return {
        "claim_p50_ms": round(statistics.median(ms["claim"]), 3),
        "claim_p99_ms": round(statistics.quantiles(ms["claim"], n=100)[98], 3),
        "complete_p50_ms": round(statistics.median(ms["complete"]), 3),
        "record_p50_ms": round(statistics.median(ms["record"]), 3),
        "completions_hz": round(1.0 / completion_s, 1),
        "episodes_hz": round(1.0 / episode_s, 1),
    }


def recorder_rates(folder: Path) -> dict[str, float]:
    """MB/s of shards from the append handler on: processor time without fsync, wall time with it."""
    requests = make_requests(0, [make_image(number) for number in range(SHARE_SAMPLES)])
    begin_s = time.thread_time()
    record(folder / "quick", requests, INGEST_EPISODES, fsync=False)
    cpu_s = time.thread_time() - begin_s
    begin_s = time.perf_counter()
    record(folder / "synced", requests, INGEST_EPISODES, fsync=True)
    wall_s = time.perf_counter() - begin_s
    size_mb = sum(shard.stat().st_size for shard in (folder / "quick").glob("*.mcap")) / 1e6
    samples = INGEST_EPISODES * sum(len(request.samples) for request in requests)
    return {
        "ingest_mb_s": round(size_mb / cpu_s, 1),
        "ingest_samples_hz": round(samples / cpu_s, 1),
        "ingest_synced_wall_mb_s": round(size_mb / wall_s, 1),
    }


def synthetic_spec() -> RunSpec:
    """A run without a scene."""
    return RunSpec(
        run="rates",
        scene_path="nowhere",
        scene_hash="0" * 64,
        scene_files=(),
        avatars_path="",
        avatar_hashes={},
        seed=0,
        split=Split.TRAIN,
        static=False,
        config={},
        metadata={},
    )


if __name__ == "__main__":
    tyro.cli(main)
