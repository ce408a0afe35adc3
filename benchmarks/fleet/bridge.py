"""Three hosts on this machine, joined by a bridge: network namespaces with separate homes, caches and working folders.

They need root and `ip`. Compiled kernels are copied to each host's cache, or they would be compiled three times.
"""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from readygo.common.extras import ROOT
from readygo.common.files import cache_root
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Ledger

BRIDGE = "readygo-net"
PORT = 7447


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
