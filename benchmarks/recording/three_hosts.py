"""A fleet on three hosts that share no files, one of which is cut off for a while: the same dataset as in one process.

    python -m readygo.benchmarks.recording.three_hosts SCENE --episodes 6 --cut-s 10

Hosts are network namespaces of this machine (it takes root and `ip`), joined by a bridge; each has a separate home,
cache and working directory. The first has the coordinator, the second a worker, the third a recorder and a worker;
all speak mTLS. The second one's link is taken down in the middle and put up again. Compiled kernels are copied to each
host's cache, or they would be compiled three times.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import tyro

from readygo.common.dataset import Dataset
from readygo.common.extras import ROOT
from readygo.common.files import cache_root
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Ledger

BRIDGE = "readygo-net"
PORT = 7447
POLL_S = 0.5


@dataclass(frozen=True)
class Host:
    """A network namespace with separate files."""

    number: int
    root: Path

    @property
    def name(self) -> str:
        """Name of the namespace."""
        return f"readygo-host{self.number}"

    @property
    def address(self) -> str:
        """IP address of the host on the bridge."""
        return f"10.99.7.{self.number}"

    @property
    def certs(self) -> Path:
        """Folder of the host's certificates."""
        return self.root / "certs"

    def start(self, *arguments: str) -> "subprocess.Popen[bytes]":
        """Run readygo there; its output goes to a log in the host's folder."""
        environment = {**os.environ, "HOME": str(self.root), "XDG_CACHE_HOME": str(self.root / "cache")}
        environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), environment.get("PYTHONPATH", "")])
        command = ["ip", "netns", "exec", self.name, sys.executable, "-m", "readygo", *arguments]
        with (self.root / f"{'-'.join(arguments[:2]).replace('/', '_')}.log").open("ab") as log:
            return subprocess.Popen(command, cwd=self.root, env=environment, stdout=log, stderr=log)


def main(
    scene: str = "embedded",
    /,
    *,
    episodes: int = 6,
    static: bool = False,
    cut_s: float = 10.0,
    timeout_s: float = 900.0,
) -> None:
    """Run it, and exit with 1 if the datasets differ.

    Args:
        scene: Scene bundle, "embedded" or "embedded:SEED".
        episodes: Episodes to record.
        static: Leave the humans out.
        cut_s: How long the second host is cut off [s].
        timeout_s: Time for all of it [s].
    """
    deadline_s = time.monotonic() + timeout_s
    with tempfile.TemporaryDirectory() as name, hosts_on_a_bridge(Path(name)) as hosts:
        alone = Path(name) / "alone"
        what = [scene, "--episodes", str(episodes), *(["--static"] if static else [])]
        readygo("generate", *what, "--out", str(alone), "--workers", "0")
        expected = Dataset([alone]).content_hash
        _issue(Path(name) / "authority", hosts)
        data, shards = hosts[0].root / "data", hosts[2].root / "shards"
        with _fleet(hosts, what, data, shards, deadline_s) as coordinator:
            ledger = RunFolder(data).ledger
            _wait(lambda: ledger.exists() and committed(data) > 0, coordinator, deadline_s)
            print(f"{committed(data)} episodes are durable: host 2 is cut off for {cut_s:g} s")
            set_link(hosts[1], "down")
            time.sleep(cut_s)
            set_link(hosts[1], "up")
            print(f"healed, {committed(data)} episodes are durable")
            _wait(lambda: coordinator.poll() is not None, None, deadline_s)
        found = Dataset([shards]).content_hash
        same = "the same" if found == expected else "ANOTHER"
        print(f"in one process {expected[:12]}, on three hosts {found[:12]}: {same}")
        if found != expected or coordinator.returncode:
            raise SystemExit(1)


@contextlib.contextmanager
def _fleet(
    hosts: Sequence[Host], what: Sequence[str], data: Path, shards: Path, deadline_s: float
) -> "Iterator[subprocess.Popen[bytes]]":
    first, second, third = hosts
    endpoint = f"tls/{first.address}:{PORT}"
    lead = ["generate", *what, "--out", str(data), "--on", "hosts"]
    processes = [first.start(*lead, "--listen", f"tls/0.0.0.0:{PORT}", "--certs", str(first.certs))]
    try:
        _wait(lambda: (data / ".readygo" / "endpoint").exists(), processes[0], deadline_s)
        run = RunFolder(data).load()[0].run
        for host, role in ((third, "recorder"), (second, "all"), (third, "all")):
            own = ["--name", "rec0", "--data", str(shards)] if role == "recorder" else []
            certs = ["--certs", str(host.certs)]
            processes.append(host.start("worker", role, "--connect", endpoint, "--run", run, *certs, *own))
        yield processes[0]
        for process in processes:
            process.wait(timeout=max(1.0, deadline_s - time.monotonic()))
    finally:
        for process in processes:
            process.kill()
            process.wait()
        for log in sorted(first.root.parent.glob("host*/*.log")):
            shutil.copy(log, Path.cwd() / f"three_hosts-{log.parent.name}-{log.name}")


def _issue(authority: Path, hosts: Sequence[Host]) -> None:
    readygo("certs", "init", str(authority))
    names = (["coordinator"], ["all"], ["all", "recorder.rec0"])
    for host, own in zip(hosts, names, strict=True):
        where = ["--authority", str(authority), "--out", str(host.certs), "--host", host.address]
        readygo("certs", "issue", *own, *where)


@contextlib.contextmanager
def hosts_on_a_bridge(folder: Path) -> Iterator[tuple[Host, ...]]:
    """Three hosts that reach each other; they are gone afterwards."""
    hosts = tuple(Host(number, folder / f"host{number}") for number in (1, 2, 3))
    _remove(hosts)
    try:
        _ip("link", "add", BRIDGE, "type", "bridge")
        _ip("link", "set", BRIDGE, "up")
        for host in hosts:
            shutil.copytree(cache_root() / "kernels", host.root / "cache" / "readygo" / "kernels")
            outer, inner = _interface(host), "eth0"
            _ip("netns", "add", host.name)
            _ip("link", "add", outer, "type", "veth", "peer", "name", inner, "netns", host.name)
            _ip("link", "set", outer, "master", BRIDGE, "up")
            _ip("-n", host.name, "address", "add", f"{host.address}/24", "dev", inner)
            _ip("-n", host.name, "link", "set", inner, "up")
            _ip("-n", host.name, "link", "set", "lo", "up")
        yield hosts
    finally:
        _remove(hosts)


def _remove(hosts: Sequence[Host]) -> None:
    for command in (["link", "delete", BRIDGE], *(["netns", "delete", host.name] for host in hosts)):
        subprocess.run(["ip", *command], check=False, capture_output=True)


def _interface(host: Host) -> str:
    return f"rg-veth{host.number}"


def set_link(host: Host, state: str) -> None:
    """Cut a host off ("down"), or join it again ("up")."""
    _ip("link", "set", _interface(host), state)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)


def readygo(*arguments: str) -> None:
    """Run a command here, to its end."""
    subprocess.run([sys.executable, "-m", "readygo", *arguments], check=True)


def committed(data: Path) -> int:
    """Durable episodes by the ledger of a data folder."""
    book = Ledger(RunFolder(data).ledger)
    try:
        return book.census.committed_counts()[0]
    finally:
        book.close()


def _wait(happened, process: "subprocess.Popen[bytes] | None", deadline_s: float) -> None:
    while not happened():
        if process is not None and process.poll() is not None:
            raise SystemExit(f"A process ended with {process.returncode}.")
        if time.monotonic() > deadline_s:
            raise SystemExit("It took too long.")
        time.sleep(POLL_S)


if __name__ == "__main__":
    tyro.cli(main)
