from pathlib import Path

import pytest

from readygo.common.messages import FileRef, PolicyRef, Stage
from readygo.services.coordinator import Ledger


@pytest.fixture
def ledger(tmp_path: Path) -> Ledger:
    return Ledger(tmp_path / "ledger.sqlite", (Stage(name="film", role="camera", records=True),))


def _policy(sha256: str) -> PolicyRef:
    return PolicyRef(path="", files=(FileRef(path="graph", sha256=sha256 * 64, size=4),), mix=0.5)


def test_offers_are_numbered_and_say_when_they_came(ledger: Ledger) -> None:
    first, second = ledger.policies.offer(_policy("a"), 10), ledger.policies.offer(_policy("b"), 20)
    assert ledger.policies.offer(_policy("a"), 30) == first
    assert ledger.policies.all() == (first, second)
    assert (first.version, first.files, first.wall_ns) == (1, _policy("a").files, 10)
    assert (second.version, second.sha256) == (2, _policy("b").sha256)


def test_files_of_a_policy_are_idle_when_no_episode_names_it_and_there_is_a_newer_one(ledger: Ledger) -> None:
    assigned = ledger.policies.offer(_policy("a"), 1)
    assert ledger.policies.idle_files() == set(), "it is the newest"
    ledger.assign({0: assigned.sha256, 1: ""})
    for name in ("b", "c"):
        ledger.policies.offer(_policy(name), 2)
    assert ledger.policies.idle_files() == {"b" * 64}
