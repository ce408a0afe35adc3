import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.fleet import bridge

CONNECT = "import socket, sys; socket.create_connection((sys.argv[1], 9), timeout=0.5)"


def _namespaces_are_allowed() -> bool:
    if os.geteuid() != 0 or shutil.which("ip") is None:
        return False
    made = subprocess.run(["ip", "netns", "add", "readygo-try"], check=False, capture_output=True)
    subprocess.run(["ip", "netns", "delete", "readygo-try"], check=False, capture_output=True)
    return made.returncode == 0


@pytest.mark.skipif(not _namespaces_are_allowed(), reason="needs root and network namespaces")
def test_hosts_reach_each_other_until_one_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cache" / "kernels").mkdir(parents=True)
    monkeypatch.setattr(bridge, "cache_root", lambda: tmp_path / "cache")
    # Other names than a benchmark that runs at the same time has.
    monkeypatch.setattr(bridge, "BRIDGE", "readygo-test")
    monkeypatch.setattr(bridge.Host, "name", property(lambda host: f"readygo-test{host.number}"))
    monkeypatch.setattr(bridge, "_interface", lambda host: f"rg-test{host.number}")

    def refused(host: bridge.Host, other: bridge.Host) -> bool:
        command = ["ip", "netns", "exec", host.name, sys.executable, "-c", CONNECT, other.address]
        # No process listens: a host that is there refuses at once.
        said = subprocess.run(command, check=False, capture_output=True, text=True).stderr
        return "ConnectionRefusedError" in said

    with bridge.hosts_on_a_bridge(tmp_path) as (first, second, _):
        assert refused(second, first)
        bridge.set_link(second, "down")
        assert not refused(second, first)
        bridge.set_link(second, "up")
        assert refused(second, first)
    assert (
        "readygo-test" not in subprocess.run(["ip", "netns", "list"], check=True, capture_output=True, text=True).stdout
    )
