"""A run on a bus, driven by hand."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from readygo.common.bus import InProcessBus
from readygo.common.errors import PolicyError
from readygo.common.messages import (
    ClaimReply,
    ClaimRequest,
    CompleteRequest,
    DoneRequest,
    GrantRequest,
    OfferReply,
    OfferRequest,
    PolicyFile,
    PolicyRef,
    Stage,
    StatusReply,
    StatusRequest,
    VerdictStatus,
    topics,
)
from readygo.common.messages.stages import ANIMATE, EXPERT_LINE, HUMAN_PLAN, ROBOT_PLAN
from readygo.services.coordinator import BlobStore, Coordinator, CoordinatorConfig, Ledger, attach
from tests.common.messages.run_specs import SPEC


class Line:
    """A coordinator on an in-process bus with a hand-set clock."""

    def __init__(
        self,
        folder: Path,
        wanted: int = 3,
        stages: tuple[Stage, ...] = EXPERT_LINE,
        policy: PolicyRef | None = None,
        metadata: Mapping[str, str] | None = None,
        **settings: object,
    ) -> None:
        self.now_s = 0.0
        self.refused = ""
        """Why offered policies cannot drive; empty if they can."""
        self.missing: set[int] = set()
        """Episodes that no shard holds, whatever recorders say."""
        self.aside: list[tuple[int, str, list[str]]] = []
        """Index, reason and stages with results of the episodes that were given up."""
        self.bus = InProcessBus()
        self.coordinator = Coordinator(
            spec=dataclasses.replace(SPEC, stages=stages, policy=policy, metadata=dict(metadata or {})),
            wanted=wanted,
            ledger=Ledger(folder / "ledger.sqlite", stages),
            blobs=BlobStore(folder / "blobs"),
            config=CoordinatorConfig(**settings),  # type: ignore[arg-type]
            check_policy=self._check_policy,
            holds=lambda report: report.index not in self.missing,
            set_aside=self._set_aside,
            clock=lambda: self.now_s,
        )
        attach(self.bus, self.coordinator)

    def _check_policy(self, files: Sequence[PolicyFile]) -> None:
        if self.refused:
            raise PolicyError(self.refused)

    def _set_aside(self, index: int, reason: str, results: Mapping[str, bytes]) -> str:
        self.aside.append((index, reason, sorted(results)))
        return ""

    def offer(self, **files: bytes) -> OfferReply:
        """Offer a policy of these files."""
        request = OfferRequest(files=tuple(PolicyFile(name=name, data=data) for name, data in files.items()))
        return self.bus.request(topics.OFFER, request)

    def claim(self, stage: Stage, worker: str = "w", numeric_class: str = "this", **life: str) -> ClaimReply:
        """Claim an episode; `life` is role and session of the worker."""
        request = ClaimRequest(worker=worker, numeric_class=numeric_class, **life)
        return self.bus.request(topics.claim(stage.name), request)

    def complete(self, stage: Stage, claim: ClaimReply, **fields: object) -> VerdictStatus:
        assert claim.episode is not None
        proof = {"attempt": claim.attempt, "lease": claim.lease}
        values = {"worker": "w", "index": claim.episode.index, **proof, **fields}
        return self.bus.request(topics.complete(stage.name), CompleteRequest(**values)).status  # type: ignore[arg-type]

    def plan(self, *, rejected: str = "") -> ClaimReply:
        """Pass the next episode through all stages before rendering."""
        for stage in (HUMAN_PLAN, ANIMATE, ROBOT_PLAN):
            claim = self.claim(stage)
            last = stage == ROBOT_PLAN
            verdict = self.complete(stage, claim, result=stage.name.encode(), rejected=rejected if last else "")
            assert verdict is VerdictStatus.OK
        return claim

    def pass_on(self, *stages: Stage) -> None:
        """Take the next episode through stages."""
        for stage in stages:
            assert self.complete(stage, self.claim(stage), result=stage.name.encode()) is VerdictStatus.OK

    def grant(self, claim: ClaimReply) -> VerdictStatus:
        assert claim.episode is not None
        request = GrantRequest(recorder="rec0", index=claim.episode.index, attempt=claim.attempt)
        return self.bus.request(topics.GRANT, request).status

    def done(self, claim: ClaimReply, policy: str = "") -> VerdictStatus:
        assert claim.episode is not None
        request = DoneRequest(
            recorder="rec0", index=claim.episode.index, attempt=claim.attempt, shard="s", sample_count=10, policy=policy
        )
        return self.bus.request(topics.DONE, request).status

    def record(self, claim: ClaimReply) -> None:
        """Make an episode durable."""
        assert (self.grant(claim), self.done(claim)) == (VerdictStatus.OK, VerdictStatus.OK)

    def status(self) -> StatusReply:
        return self.bus.request(topics.STATUS, StatusRequest())


def line_to_two_recorders(folder: Path) -> Line:
    """A run with four episodes that wait for their images."""
    line = Line(folder, wanted=4, recorders=("rec0", "east"))
    for _ in range(4):
        line.plan()
    return line
