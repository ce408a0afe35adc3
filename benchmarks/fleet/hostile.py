"""Messages from a hostile process that has a run's token, or from another version: none may cost an episode.

Before the first claim a run has no numeric class; it takes the first one named, by any process that may join. Two
kinds of message are left out: commands (`ctl`: any process that may join may cancel), and reports in the name of a
worker or recorder about what it really holds, because only certificates tell them from genuine ones.
"""

import dataclasses
import random
from collections.abc import Callable
from typing import Any

import numpy as np

from readygo.benchmarks.recording.dataset import make_requests
from readygo.common.bus import Bus
from readygo.common.errors import BusError
from readygo.common.messages import (
    AppendStatus,
    BlobRequest,
    ClaimRequest,
    ClaimStatus,
    CompleteRequest,
    DoneRequest,
    GrantRequest,
    OfferRequest,
    PolicyFile,
    RunSpec,
    TroubleRequest,
    VerdictStatus,
    topics,
)

TIMEOUT_S = 2.0
UNANSWERED_MAX = 4
"""No more lies are sent after this many went unanswered: the process that was asked is not there."""
MANY = 200_000
"""Lists in one message: more than any message may hold."""


def send_lies(bus: Bus, spec: RunSpec, rng: random.Random) -> str:
    """Tell a run many lies.

    Returns:
        How many were refused, unanswered and believed, in words.
    """
    lies = [*_nonsense(bus, spec, rng), *_claims(bus, spec), *_reports(bus, spec, rng), *_samples(bus, spec, rng)]
    rng.shuffle(lies)
    refused = unanswered = 0
    believed: list[str] = []
    for name, lie in lies:
        if unanswered >= UNANSWERED_MAX:
            break
        try:
            answer = lie()
        except BusError as error:
            unanswered += "No participant answered" in str(error)
            refused += "No participant answered" not in str(error)
        else:
            refused += answer
            believed += [] if answer else [name]
    return f"{refused} refused, {unanswered} unanswered" + "".join(f", BELIEVED: {name}" for name in believed)


Lie = tuple[str, Callable[[], bool]]
"""Name of a lie, and a function that sends it and returns True if it was refused."""


def _nonsense(bus: Bus, spec: RunSpec, rng: random.Random) -> list[Lie]:
    """Payloads that are no valid message, to every topic of the coordinator and of a recorder."""
    deep: list[Any] = []
    for _ in range(300):
        deep = [deep]
    payloads = (
        {},
        {"recorder": 7, "index": "x", "worker": None},
        {"x": np.zeros(1, "m8[s]")},
        {"episode": {"seed": -1, "split": "other", "index": 2**62}, "attempt": -1},
        deep,
        [[] for _ in range(MANY)],
        rng.randbytes(1000),
    )
    stage = spec.stages[-1].name
    asked = [topics.claim(stage), topics.renew(stage), topics.complete(stage), topics.EXPECT, topics.GRANT]
    asked += [topics.DONE, topics.LOST, topics.TROUBLE, topics.PENDING, topics.BLOB, topics.OFFER]
    asked += [topics.append(name) for name in _recorders(spec)]
    return [
        (f"{topic.name} of nonsense", _sender(bus, topic, payload, _says_no))
        for topic in asked
        for payload in rng.sample(payloads, 2)
    ]


def _claims(bus: Bus, spec: RunSpec) -> list[Lie]:
    """Claims that must not get a lease."""
    claims = [ClaimRequest(worker="stranger"), ClaimRequest(worker="stranger", numeric_class="another")]
    return [
        ("claim of another numeric class", _sender(bus, topics.claim(stage.name), claim, _no_lease))
        for stage in spec.stages
        for claim in claims
    ]


def _reports(bus: Bus, spec: RunSpec, rng: random.Random) -> list[Lie]:
    """Reports of what did not happen."""
    (recorder, *_), stage, index = _recorders(spec), spec.stages[-1], rng.randrange(20)
    forged = CompleteRequest(worker="stranger", index=index, attempt=rng.randrange(8), rejected="forged")
    done = DoneRequest(recorder=recorder, index=index, attempt=3, shard="shard-rec0-00099.mcap", sample_count=9)
    policy = PolicyFile(name="policy.onnx", data=b"no network")
    return [
        ("rejection of another's lease", _sender(bus, topics.complete(stage.name), forged, _not_ok)),
        (
            "failure of another's lease",
            _sender(
                bus,
                topics.complete(spec.stages[0].name),
                dataclasses.replace(forged, rejected="", failed="forged"),
                _not_ok,
            ),
        ),
        ("done outside", _sender(bus, topics.DONE, dataclasses.replace(done, shard="../../etc/passwd"), _not_ok)),
        ("done of an attempt to come", _sender(bus, topics.DONE, dataclasses.replace(done, attempt=99), _not_ok)),
        ("done of no recorder", _sender(bus, topics.DONE, dataclasses.replace(done, recorder="rec-unknown"), _not_ok)),
        ("done without samples", _sender(bus, topics.DONE, {**dataclasses.asdict(done), "sample_count": -5}, _not_ok)),
        ("done of nothing", _sender(bus, topics.DONE, dataclasses.replace(done, index=10**6), _not_ok)),
        (
            "grant to no recorder",
            _sender(bus, topics.GRANT, GrantRequest(recorder="rec-unknown", index=index, attempt=1), _not_ok),
        ),
        (
            "trouble of no recorder",
            _sender(bus, topics.TROUBLE, TroubleRequest(recorder="rec-unknown", reason="forged"), _not_ok),
        ),
        ("blob outside", _sender(bus, topics.BLOB, {"sha256": "../ledger.sqlite", "offset": 0}, lambda r: r.size < 0)),
        (
            "blob before its beginning",
            _sender(bus, topics.BLOB, BlobRequest(sha256="0" * 64, offset=-1), lambda r: r.size < 0),
        ),
        (
            "policy for a run that takes none",
            _sender(bus, topics.OFFER, OfferRequest(files=(policy,)), lambda r: False),
        ),
    ]


def _samples(bus: Bus, spec: RunSpec, rng: random.Random) -> list[Lie]:
    """Samples without a lease, of this run and of another."""
    image = rng.randbytes(2000)
    first = make_requests(rng.randrange(20), [image])[0]
    key = dataclasses.replace(first.header.episode, seed=spec.seed, split=spec.split)
    ours = dataclasses.replace(first, header=dataclasses.replace(first.header, episode=key))
    other = dataclasses.replace(key, seed=spec.seed + 1)
    lies = {
        "samples of an attempt to come": dataclasses.replace(ours, attempt=10**9),
        "samples of no attempt": dataclasses.replace(ours, attempt=-1),
        "samples of another seed": dataclasses.replace(
            ours, header=dataclasses.replace(ours.header, episode=other), attempt=10**9
        ),
    }
    return [
        (name, _sender(bus, topics.append(recorder), lie, lambda reply: reply.status is not AppendStatus.OK))
        for name, lie in lies.items()
        for recorder in _recorders(spec)
    ]


def _sender(bus: Bus, topic: Any, message: Any, refused: Callable[[Any], bool]) -> Callable[[], bool]:
    return lambda: refused(bus.request(topic, message, timeout_s=TIMEOUT_S))


def _recorders(spec: RunSpec) -> list[str]:
    return list(spec.config["coordinator"]["recorders"])


def _not_ok(verdict: Any) -> bool:
    return verdict.status is not VerdictStatus.OK


def _no_lease(reply: Any) -> bool:
    return reply.status is not ClaimStatus.LEASE


def _says_no(reply: Any) -> bool:
    """Nonsense that can be read as a question may be answered, but with nothing."""
    status = getattr(reply, "status", None)
    return status not in (VerdictStatus.OK, ClaimStatus.LEASE, AppendStatus.OK)
