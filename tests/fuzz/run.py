"""Gives a reader many inputs, in processes of limited memory and time, and counts what comes of them."""

import faulthandler
import json
import mmap
import os
import resource
import select
import signal
import struct
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from readygo.common.errors import ReadygoError
from tests.fuzz.mutate import Dice, Mutate

MEMORY_MAX = 2**30
"""More than this above what the process had is a finding [bytes]."""
ADDRESSES_MAX = 5 * 2**29
"""Allocations beyond this fail, so that a finding does not take the machine's memory [bytes]."""
CPU_MAX_S = 5.0
SILENT_MAX_S = 90.0
"""An input that is not done by then waits for something [s, wall clock]."""
LOOK_EVERY_S = 5.0
BATCH = 400
KEPT_MAX = 5
"""Inputs that are kept of each kind of finding."""


class Seed(NamedTuple):
    """A valid input."""

    data: bytes
    about: Any = None
    """What the reader is told beside it, such as the class of a message."""


@dataclass(frozen=True, kw_only=True)
class Target:
    """A reader of bytes from elsewhere."""

    name: str
    seeds: Callable[[Path], list[Seed]]
    """Makes valid inputs, given a folder in which all that the reader needs beside them may be left."""
    read: Callable[[bytes, Any, Path], object]
    """Reads an input, given what the seed says, and the folder."""
    mutate: Mutate
    refusals: tuple[type[BaseException], ...] = (ReadygoError,)
    """What the reader is documented to raise."""


@dataclass(kw_only=True)
class Counts:
    """What came of a target's inputs."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    tracebacks: int = 0
    crashes: int = 0
    above_memory: int = 0
    above_time: int = 0
    failed_allocations: int = 0
    """Of the refused: those that a failed allocation was the reason of."""
    peak_mb: float = 0.0
    """Most memory that a batch took above what the process had before."""
    seconds: float = 0.0
    """Processor time of all inputs."""
    findings: dict[str, int] = field(default_factory=dict)

    def add(self, more: "Counts") -> None:
        """Count further inputs of the same target."""
        for name, value in asdict(more).items():
            if name == "findings":
                for words, count in value.items():
                    self.findings[words] = self.findings.get(words, 0) + count
            elif name == "peak_mb":
                self.peak_mb = max(self.peak_mb, value)
            else:
                setattr(self, name, round(getattr(self, name) + value, 1))

    @property
    def ok(self) -> bool:
        """True if nothing was found."""
        return not (self.tracebacks or self.crashes or self.above_memory or self.above_time)


_ROOT = Path(__file__).resolve().parents[2]
_SHARED = struct.Struct("<qqqqd")
"""Between a batch and who waits for it: input under way, accepted, refused, failed allocations, peak memory."""


def input_of(target: Target, seeds: list[Seed], number: int, key: int) -> tuple[bytes, Any]:
    """An input by its number: the same in every run of the same seeds.

    Args:
        target: Whose.
        seeds: Its valid inputs; the first numbers are these themselves.
        number: From 0 on.
        key: Of the whole run.
    """
    if number < len(seeds):
        return seeds[number]
    philox = np.random.Philox(key=[zlib.crc32(target.name.encode()), key], counter=[0, 0, 0, number])
    seed = seeds[number % len(seeds)]
    return target.mutate(seed.data, Dice(np.random.Generator(philox))), seed.about


def fuzz(target: Target, first: int, count: int, *, key: int, keep: Path | None = None) -> Counts:
    """Give a target its inputs `first` to `first + count`.

    Args:
        target: The reader.
        first: Number of the first input.
        count: How many.
        key: Of the whole run.
        keep: Folder for inputs that are findings.

    Raises:
        RuntimeError: If the reader refuses a valid input.
    """
    with tempfile.TemporaryDirectory() as folder, mmap.mmap(-1, _SHARED.size) as shared:
        place = Path(folder)
        seeds = target.seeds(place)
        for seed in seeds:
            try:
                # Loads what the reader imports and compiles.
                target.read(seed.data, seed.about, place)
            except Exception as error:
                raise RuntimeError(f"{target.name} refuses a valid input: {error!r}") from error
        counts, log = Counts(), _Findings(target.name, keep)
        number = first
        while number < first + count:
            end = min(number + BATCH, first + count)
            shared.seek(0)
            shared.write(_SHARED.pack(number, 0, 0, 0, 0.0))
            reader, writer = os.pipe()
            child = os.fork()
            if not child:
                os.close(reader)
                try:
                    _work(target, seeds, range(number, end), key, place, shared, writer)
                finally:
                    os._exit(1)
            os.close(writer)
            said, killed = _told(reader, child, shared)
            status, used = os.wait4(child, 0)[1:]
            counts.seconds += used.ru_utime + used.ru_stime
            current, accepted, refused, failed, peak = _SHARED.unpack(shared[:])
            counts.accepted += accepted
            counts.refused += refused
            counts.failed_allocations += failed
            counts.peak_mb = max(counts.peak_mb, round(peak, 1))
            for each in said:
                setattr(counts, each["kind"], getattr(counts, each["kind"]) + 1)
                log.add(each["kind"], each["words"], each["number"], input_of(target, seeds, each["number"], key)[0])
            if os.WIFEXITED(status) and os.WEXITSTATUS(status):
                raise RuntimeError(f"{target.name}: input {current} cannot be made")
            if os.WIFEXITED(status) and not killed:
                # A batch ends early after a finding that left its memory large.
                counts.inputs += current + 1 - number
                number = current + 1
                continue
            slow = killed or os.WTERMSIG(status) in (signal.SIGPROF, signal.SIGXCPU)
            counts.above_time += slow
            counts.crashes += not slow
            words = "waits" if killed else f"signal {os.WTERMSIG(status)}"
            log.add("above_time" if slow else "crashes", words, current, input_of(target, seeds, current, key)[0])
            counts.inputs += current + 1 - number
            number = current + 1
        counts.findings = log.counts
        counts.seconds = round(counts.seconds, 1)
        return counts


class _Findings:
    """Counts findings by kind and place, and keeps the first inputs of each."""

    def __init__(self, name: str, keep: Path | None) -> None:
        self._name, self._keep = name.replace(" ", "_").replace("/", "_"), keep
        self.counts: dict[str, int] = {}

    def add(self, kind: str, words: str, number: int, data: bytes) -> None:
        """Note a finding."""
        words = f"{kind}: {words}"
        self.counts[words] = self.counts.get(words, 0) + 1
        if self._keep is not None and self.counts[words] <= KEPT_MAX:
            self._keep.mkdir(parents=True, exist_ok=True)
            (self._keep / f"{self._name}-{number}.bin").write_bytes(data)
            with (self._keep / f"{self._name}.txt").open("a") as log:
                log.write(f"{number}: {words}\n")


def _told(reader: int, child: int, shared: mmap.mmap) -> tuple[list[dict[str, Any]], bool]:
    """What a batch says until it ends, and whether it had to be killed because it waited for something."""
    said, killed, at, since_s = b"", False, -1, time.monotonic()
    with os.fdopen(reader, "rb", buffering=0) as stream:
        while True:
            if select.select([stream], [], [], LOOK_EVERY_S)[0]:
                piece = stream.read(1 << 16)
                if not piece:
                    break
                said += piece
            now = _SHARED.unpack(shared[:])[0]
            if now != at:
                at, since_s = now, time.monotonic()
            elif time.monotonic() - since_s > SILENT_MAX_S and not killed:
                os.kill(child, signal.SIGKILL)
                killed = True
    return [json.loads(line) for line in said.splitlines()], killed


def _work(
    target: Target, seeds: list[Seed], numbers: range, key: int, place: Path, shared: mmap.mmap, writer: int
) -> None:
    """Read a batch of inputs, in a process of its own, and leave it."""
    _limit()
    base = _resident_mb()
    accepted = refused = failed = 0
    for number in numbers:
        data, about = input_of(target, seeds, number, key)
        shared[:] = _SHARED.pack(number, accepted, refused, failed, _resident_mb() - base)
        signal.setitimer(signal.ITIMER_PROF, CPU_MAX_S)
        kind = words = ""
        try:
            target.read(data, about, place)
            accepted += 1
        except target.refusals as error:
            refused += 1
            failed += _is_of_memory(error)
        except BaseException as error:
            kind = "tracebacks"
            frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/fuzz/" not in frame.filename]
            where = f"{os.path.relpath(frames[-1].filename, _ROOT)}:{frames[-1].lineno}" if frames else ""
            words = f"{type(error).__name__} at {where}: {str(error)[:100]}"
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        large = _resident_mb() - base > MEMORY_MAX / 1e6
        for found, why in ((kind, words), ("above_memory" if large else "", f"{_resident_mb() - base:.0f} MB")):
            if found:
                os.write(writer, json.dumps({"kind": found, "words": why, "number": number}).encode() + b"\n")
        shared[:] = _SHARED.pack(number, accepted, refused, failed, _resident_mb() - base)
        if large:
            break
    os._exit(0)


def _limit() -> None:
    faulthandler.disable()
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(null, stream)
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    with open("/proc/self/statm") as file:
        size = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + ADDRESSES_MAX, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _resident_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def _is_of_memory(error: BaseException | None) -> bool:
    while error is not None:
        if isinstance(error, MemoryError):
            return True
        error = error.__cause__ or error.__context__
    return False


def total(found: dict[str, Counts]) -> dict[str, Any]:
    """The sums over all targets."""
    names = (
        "inputs",
        "accepted",
        "refused",
        "tracebacks",
        "crashes",
        "above_memory",
        "above_time",
        "failed_allocations",
    )
    sums: dict[str, Any] = {name: sum(getattr(each, name) for each in found.values()) for name in names}
    sums["peak_mb"] = max((each.peak_mb for each in found.values()), default=0.0)
    sums["seconds"] = round(sum(each.seconds for each in found.values()), 1)
    return sums


def as_mapping(found: dict[str, Counts]) -> dict[str, Any]:
    """All counts as plain values."""
    return {name: asdict(found[name]) for name in sorted(found)}
