"""What recording and reading cost: `python -m readygo.benchmarks.recording.dataset [--folder FOLDER]`.

Samples are 144x256 JPEGs of some 14 kB. Times are CPU time of the thread, except the fsync line, which is wall time.
"""

import argparse
import dataclasses
import math
import tempfile
import time
import zlib
from pathlib import Path

import cv2
import numpy as np

from readygo.common.bus import InProcessBus
from readygo.common.dataset import Dataset, Provenance, encode_episode, validate
from readygo.common.dataset.index import index_path
from readygo.common.dataset.stage import Scenery
from readygo.common.messages import (
    AppendRequest,
    EpisodeHeader,
    EpisodeKey,
    PendingReply,
    Sample,
    Split,
    Verdict,
    VerdictStatus,
    decode,
    encode,
    topics,
)
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import STEP_NS
from readygo.services.recorder import Recorder, RecorderConfig, handle_append

EPISODES, SAMPLES, WINDOWS = 40, 300, 20_000


def make_bus() -> InProcessBus:
    """A bus with a coordinator that grants everything."""
    bus = InProcessBus()
    bus.serve(topics.EXPECT, lambda request: Verdict(status=VerdictStatus.OK))
    bus.serve(topics.GRANT, lambda request: Verdict(status=VerdictStatus.OK))
    bus.serve(topics.DONE, lambda request: Verdict(status=VerdictStatus.OK))
    bus.serve(topics.PENDING, lambda request: PendingReply(indices=()))
    return bus


def make_image(number: int) -> bytes:
    """A JPEG of about the size of a rendered frame."""
    rng = np.random.default_rng(number)
    smooth = cv2.resize(rng.integers(0, 255, (9, 16, 3), dtype=np.uint8), (256, 144), interpolation=cv2.INTER_CUBIC)
    noisy = np.clip(smooth + rng.normal(0, 7, (144, 256, 1)), 0, 255).astype(np.uint8)
    return cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()


def make_requests(index: int, images: list[bytes]) -> list[AppendRequest]:
    """The batches of one episode."""
    header = EpisodeHeader(
        episode=EpisodeKey(seed=0, split=Split.TRAIN, index=index),
        sample_count=SAMPLES,
        goal_xy_m=(5.0, 0.0),
        start_xyyaw=(0.0, 0.0, 0.0),
        avatars=("ann", "bob"),
        encounters=("crossing", "parallel"),
        image_format="jpeg",
        height_px=144,
        width_px=256,
        K_px=(107.4, 0.0, 128.0, 0.0, 107.4, 72.0, 0.0, 0.0, 1.0),
    )
    samples = [
        Sample(
            seq=seq,
            crc32=zlib.crc32(images[seq % len(images)]),
            time_ns=seq * STEP_NS,
            image=images[seq % len(images)],
            action_v_mps=0.5,
            action_w_radps=0.1,
            goal_xy_robot_m=(3.0, 1.0),
            robot_xyzyaw=(0.01 * seq, 0.0, 0.0, 0.3),
            humans_xyzyaw=((1.0, 2.0, 0.0, 1.0), (2.0, 1.0, 0.0, 2.0)),
            human_distance_m=2.0,
            time_to_collision_s=math.inf,
            human_visible=True,
            expert_cost=1.0,
            replanned=False,
        )
        for seq in range(SAMPLES)
    ]
    batches = [tuple(samples[first : first + 8]) for first in range(0, SAMPLES, 8)]
    return [
        AppendRequest(
            attempt=1, header=header, first_seq=batch[0].seq, samples=batch, last=batch[-1].seq == SAMPLES - 1
        )
        for batch in batches
    ]


def record(folder: Path, requests: list[AppendRequest], episodes: int, *, fsync: bool) -> None:
    """Record the same episode under many indices."""
    stage = Scenery(robot=RobotConfig())
    recorder = Recorder(folder, "r0", make_bus(), Provenance(), RecorderConfig(fsync=fsync), stage)
    for index in range(episodes):
        key = EpisodeKey(seed=0, split=Split.TRAIN, index=index)
        header = dataclasses.replace(requests[0].header, episode=key)
        for request in requests:
            handle_append(recorder, dataclasses.replace(request, header=header))
    recorder.close()


def report(name: str, value: float, unit: str) -> None:
    """Print one figure."""
    print(f"{name:<58} {value:>10,.1f} {unit}")


def measure_recording(folder: Path, requests: list[AppendRequest]) -> None:
    """Measure recording, from the append handler to the finished shard."""
    count = EPISODES * SAMPLES
    begin_s = time.thread_time()
    record(folder / "data", requests, EPISODES, fsync=False)
    cpu_s = time.thread_time() - begin_s
    size_mb = sum(shard.stat().st_size for shard in (folder / "data").glob("*.mcap")) / 1e6
    report("append to durable, in process, no fsync", cpu_s / count * 1e6, "us per sample")
    report("", count / cpu_s, "samples/s")
    report("", size_mb / cpu_s, "MB/s")
    begin_s = time.perf_counter()
    record(folder / "synced", requests, 10, fsync=True)
    report("the same with fsync per episode (wall time)", 10 * SAMPLES / (time.perf_counter() - begin_s), "samples/s")
    begin_s = time.thread_time()
    for request in requests:
        decode(AppendRequest, encode(request))
    report("message encode and decode, 8 samples per batch", (time.thread_time() - begin_s) / SAMPLES * 1e6, "us")


def measure_stage(requests: list[AppendRequest]) -> None:
    """What an episode costs more because viewers shall show it."""
    header, samples = requests[0].header, [sample for request in requests for sample in request.samples]
    stage = Scenery(robot=RobotConfig())
    encode_s = stage_s = 0.0
    for _ in range(10):
        begin_s = time.thread_time()
        chunk = encode_episode(header, 1, samples)
        encode_s += time.thread_time() - begin_s
        begin_s = time.thread_time()
        staged = stage.stage_episode(chunk, 10**9, with_map=False)
        stage_s += time.thread_time() - begin_s
    report("encode an episode", encode_s / 10 / SAMPLES * 1e6, "us per sample")
    report("stage it for viewers", stage_s / 10 / SAMPLES * 1e6, "us per sample")
    report("", (len(staged.data) - len(chunk.data)) / SAMPLES, "bytes per sample")


def measure_reading(folder: Path) -> None:
    """Opening, windows, index and validation."""
    begin_s = time.thread_time()
    dataset = Dataset([folder])
    report(f"open a dataset of {len(dataset)} samples", (time.thread_time() - begin_s) * 1e3, "ms")
    rng = np.random.default_rng(0)
    windows = dataset.windows(rng.integers(0, len(dataset), WINDOWS)).tolist()
    for window in windows[:2000]:
        [dataset.image(sample) for sample in window]
    begin_s = time.thread_time()
    for window in windows:
        [dataset.image(sample) for sample in window]
    report("random 3-frame windows, encoded", WINDOWS / (time.thread_time() - begin_s), "windows/s")
    begin_s = time.thread_time()
    for window in windows[:1000]:
        [dataset.decode(sample) for sample in window]
    report("random 3-frame windows, decoded", 1000 / (time.thread_time() - begin_s), "windows/s")
    for shard in dataset.shards:
        index_path(shard).unlink()
    begin_s = time.thread_time()
    Dataset([folder])
    report("make the index again", (time.thread_time() - begin_s) / len(dataset) * 1e6, "us per sample")
    begin_s = time.thread_time()
    validate(folder)
    report("validate", len(dataset) / (time.thread_time() - begin_s), "samples/s")


def main() -> None:
    """Record, read, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="where to record; a temporary folder by default")
    with tempfile.TemporaryDirectory(dir=parser.parse_args().folder) as name:
        cv2.setNumThreads(1)
        images = [make_image(number) for number in range(64)]
        report("image", sum(map(len, images)) / len(images) / 1e3, "kB")
        measure_recording(Path(name), make_requests(0, images))
        measure_stage(make_requests(0, images))
        measure_reading(Path(name) / "data")


if __name__ == "__main__":
    main()
