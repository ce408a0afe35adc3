import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.fleet import faults
from readygo.benchmarks.fleet.faults import Fault, Kind, bring_about, schedule
from readygo.benchmarks.fleet.site import LAUNCHER, DataSite
from readygo.runs.folder import RunFolder

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def _fault(kind: Kind, pick: float = 0.5) -> Fault:
    return Fault(kind=kind, after=0, delay_s=0.0, pick=pick, duration_s=1.0)


@pytest.fixture
def site(tmp_path: Path) -> DataSite:
    """A site with a shard and a result, and no processes."""
    folder = RunFolder(tmp_path)
    folder.blobs.mkdir(parents=True)
    (folder.blobs / "0a").write_bytes(bytes(100))
    (tmp_path / "shard-rec0-00000.mcap").write_bytes(bytes(1000))
    return DataSite([], folder, tmp_path / "log")


def test_seed_fixes_the_schedule_and_every_kind_comes_up() -> None:
    planned = schedule(500, 200, seed=3, longest_s=10.0)
    assert planned == schedule(500, 200, seed=3, longest_s=10.0)
    assert planned != schedule(500, 200, seed=4, longest_s=10.0)
    assert len(planned) == 200
    assert {fault.kind for fault in planned} == set(Kind)
    assert {fault.kind for fault in schedule(10, len(Kind), seed=0, longest_s=2.0)} == set(Kind)
    assert [fault.after for fault in planned] == sorted(fault.after for fault in planned)
    assert planned[0].after < 20
    assert planned[-1].after >= 480
    assert all(faults.SHORTEST_S <= fault.duration_s <= 10.0 for fault in planned)


@pytest.mark.parametrize(
    ("kind", "name"), [(Kind.DAMAGE_BLOB, ".readygo/blobs/0a"), (Kind.DAMAGE_SHARD, "shard-rec0-00000.mcap")]
)
def test_damage_changes_one_byte(kind: Kind, name: str, site: DataSite) -> None:
    file = site.folder.path / name
    before = file.read_bytes()
    assert not bring_about(site, _fault(kind)).skipped
    assert sum(a != b for a, b in zip(file.read_bytes(), before, strict=True)) == 1


def test_shards_are_cut_off_and_lost(site: DataSite) -> None:
    shard = site.folder.path / "shard-rec0-00000.mcap"
    bring_about(site, _fault(Kind.CUT_SHARD, pick=0.3))
    assert shard.stat().st_size == 300
    bring_about(site, _fault(Kind.LOSE_SHARD))
    assert not shard.exists()
    trace = bring_about(site, _fault(Kind.LOSE_SHARD))
    assert (trace.skipped, trace.later) == (True, True)


def test_disk_of_the_whole_machine_is_never_filled(site: DataSite) -> None:
    trace = bring_about(site, _fault(Kind.FULL_DISK))
    assert (trace.skipped, trace.later) == (True, False)


def test_stopped_worker_goes_on_and_killed_ones_are_named(site: DataSite, monkeypatch: pytest.MonkeyPatch) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        monkeypatch.setattr(site, "processes", lambda: {LAUNCHER: os.getpid(), "renderer0": process.pid})
        trace = bring_about(site, _fault(Kind.FREEZE))
        assert trace.undo is not None
        trace.undo()
        assert bring_about(site, _fault(Kind.KILL_TWO)).later, "the launcher is no worker"
        assert bring_about(site, _fault(Kind.KILL)).words == "renderer0"
        assert process.wait() == -signal.SIGKILL
    monkeypatch.setattr(site, "processes", dict)
    assert bring_about(site, _fault(Kind.FREEZE_ROUTER)).later


def test_names_of_a_fleet_that_is_not_there_are_not_taken(site: DataSite) -> None:
    trace = bring_about(site, _fault(Kind.TWICE_NAMED))
    assert trace.skipped
    assert trace.later
