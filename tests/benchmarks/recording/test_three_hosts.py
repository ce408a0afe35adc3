import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.recording import three_hosts

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
    monkeypatch.setattr(three_hosts, "cache_root", lambda: tmp_path / "cache")
    # Beside those of somebody who runs it.
    monkeypatch.setattr(three_hosts, "BRIDGE", "readygo-test")
    monkeypatch.setattr(three_hosts.Host, "name", property(lambda host: f"readygo-test{host.number}"))
    monkeypatch.setattr(three_hosts, "_interface", lambda host: f"rg-test{host.number}")

    def refused(host: three_hosts.Host, other: three_hosts.Host) -> bool:
        command = ["ip", "netns", "exec", host.name, sys.executable, "-c", CONNECT, other.address]
        # Nobody listens: a host that is there says so at once.
        said = subprocess.run(command, check=False, capture_output=True, text=True).stderr
        return "ConnectionRefusedError" in said

    with three_hosts.hosts_on_a_bridge(tmp_path) as (first, second, _):
        assert refused(second, first)
        three_hosts.set_link(second, "down")
        assert not refused(second, first)
        three_hosts.set_link(second, "up")
        assert refused(second, first)
    assert (
        "readygo-test" not in subprocess.run(["ip", "netns", "list"], check=True, capture_output=True, text=True).stdout
    )
