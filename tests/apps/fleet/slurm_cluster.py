"""A real Slurm on this machine, for tests."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from readygo.common.bus.zenoh_bus import free_endpoint

DAEMONS = ("munged", "slurmctld", "slurmd")
CONF = """
ClusterName=test
SlurmctldHost=localhost
SlurmctldPort={controller}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
SlurmdTimeout=10
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_interval=1
ReturnToService=2
KillWait=5
MpiDefault=none
SlurmdParameters=config_overrides
{nodes}
PartitionName=debug Nodes={names} Default=YES MaxTime=INFINITE State=UP
"""


@contextmanager
def slurm_cluster(folder: Path, names: Sequence[str], *, cpus: int) -> Iterator[dict[str, "subprocess.Popen[bytes]"]]:
    """Run Slurm with some nodes on this machine; tests are skipped where it is not installed or does not start.

    Args:
        folder: For its state and logs.
        names: Names of the nodes.
        cpus: Cores that each node says it has.

    Yields:
        The daemon of each node.
    """
    missing = [name for name in DAEMONS if shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin") is None]
    if missing or os.geteuid() != 0:
        pytest.skip(f"needs root and {', '.join(missing) or 'nothing else'}: apt-get install slurm-wlm munge")
    for name in ("state", "spool", "munge"):
        (folder / name).mkdir(mode=0o700, parents=True)
    key = folder / "munge" / "key"
    key.write_bytes(os.urandom(1024))
    key.chmod(0o600)
    conf = folder / "slurm.conf"
    nodes = "\n".join(f"NodeName={name} NodeHostname=localhost Port={_port()} CPUs={cpus}" for name in names)
    conf.write_text(CONF.format(controller=_port(), folder=folder, nodes=nodes, names=",".join(names)))
    environment = {**os.environ, "SLURM_CONF": str(conf), "PATH": f"{os.environ['PATH']}:/usr/sbin"}
    files = {"socket": "socket", "pid-file": "pid", "log-file": "log", "seed-file": "seed", "key-file": "key"}
    munged = ["munged", "--foreground", "--force", *(f"--{o}={folder}/munge/{f}" for o, f in files.items())]
    commands = [munged, ["slurmctld", "-D"], *(["slurmd", "-D", "-N", name] for name in names)]
    daemons = []
    patch = pytest.MonkeyPatch()
    patch.setenv("SLURM_CONF", str(conf))
    try:
        for command in commands:
            quiet = subprocess.DEVNULL
            daemons.append(subprocess.Popen(command, env=environment, stdout=quiet, stderr=quiet))
            time.sleep(0.5)
        _wait_until_idle(len(names))
        yield dict(zip(names, daemons[-len(names) :], strict=True))
    finally:
        for daemon in reversed(daemons):
            daemon.terminate()
            daemon.wait(timeout=30)
        patch.undo()


def kill_node(name: str, daemon: "subprocess.Popen[bytes]") -> None:
    """End a node as a crash of its machine does: its daemon first, then what watches its jobs, then the jobs."""
    daemon.kill()
    daemon.wait()
    jobs = _processes_of(name)
    for pid in [*({_parent(pid) for pid in jobs} - {*jobs, 0, 1}), *jobs]:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _port() -> str:
    return free_endpoint().rpartition(":")[2]


def _wait_until_idle(nodes: int) -> None:
    states: list[str] = []
    for _ in range(120):
        found = subprocess.run(["sinfo", "-h", "-N", "-o", "%T"], capture_output=True, text=True, check=False).stdout
        states = found.split()
        if states == ["idle"] * nodes:
            return
        time.sleep(0.5)
    pytest.skip(f"Slurm does not start here: {' '.join(states) or 'no answer'}")


def _processes_of(name: str) -> list[int]:
    """Processes of the jobs of a node of this cluster."""
    wanted = {f"SLURMD_NODENAME={name}".encode(), f"SLURM_CONF={os.environ['SLURM_CONF']}".encode()}
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if wanted <= set(path.read_bytes().split(b"\0")):
                found.append(int(path.parent.name))
    return found


def _parent(pid: int) -> int:
    with suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0
