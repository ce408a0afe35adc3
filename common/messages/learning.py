"""Learning while a run continues: policies that are offered to it, and what it has recorded."""

import re
from dataclasses import dataclass
from typing import ClassVar

from readygo.common.messages.checks import check_sha256
from readygo.common.messages.samples import EpisodeHeader, Sample


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyFile:
    """One file of a policy's folder."""

    name: str
    data: bytes

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", self.name):
            raise ValueError(f"a policy's file must have a plain name, got {self.name!r}.")


@dataclass(frozen=True, kw_only=True, slots=True)
class OfferRequest:
    """Let this policy drive in the episodes that begin from now on."""

    files: tuple[PolicyFile, ...]
    """All that the policy is loaded from."""


@dataclass(frozen=True, kw_only=True, slots=True)
class OfferReply:
    """The policy as the run knows it."""

    version: int
    """Number of the policy in the run, from 1; equal files have equal versions."""
    sha256: str
    """SHA-256 over the names and hashes of its files; episodes that it drives are recorded with it."""

    def __post_init__(self) -> None:
        check_sha256("sha256", self.sha256)


@dataclass(frozen=True, kw_only=True, slots=True)
class CommittedEpisode:
    """An episode that is durable, with all that was recorded of it."""

    ITEMS_MAX: ClassVar[int] = 1_000_000
    """Most lists, maps and arrays in the message, instead of the codec's default: a sample takes a dozen."""

    header: EpisodeHeader
    attempt: int
    samples: tuple[Sample, ...]
