"""Checks whether a machine has the software and hardware that readygo needs."""

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import readygo
from readygo.common.cores import available_cores
from readygo.common.errors import ReadygoError
from readygo.common.extras import Extra, install_command
from readygo.common.files import cache_folder, cache_root

PACKAGES = ("numpy", "numba", "scipy", "opencv-python-headless", "msgpack", "eclipse-zenoh", "mcap", "protobuf", "tyro")
"""Packages of every installation, whose versions may affect a run's numbers."""
EXTRAS: dict[Extra, tuple[str, str]] = {
    "policy": ("onnxruntime", "driving by a policy, evaluate"),
    "train": ("torch", "train, learn"),
    "gpu": ("gsplat", "the gsplat backend"),
    "reconstruct": ("pycolmap", "scene poses"),
    "export": ("pyarrow", "export to LeRobot and Parquet"),
    "robot-logs": ("rosbags", "import of robot logs"),
    "metrics": ("prometheus_client", "--metrics"),
    "ray": ("ray", "sweeps on a Ray cluster"),
}
"""For each extra: a package that shows whether it is installed, and its purpose."""
FREE_MIN_GB = 2.0
ROUTER_PORT = 7447
"""Zenoh's usual port, which `--listen` names most often."""


@dataclass(frozen=True)
class Finding:
    """Result of one check."""

    name: str
    good: bool | None
    """True: passed; False: readygo cannot work until this is mended; None: information only."""
    text: str


def examine(data: Path) -> list[Finding]:
    """Run all checks of this machine.

    Args:
        data: Folder whose disk is checked.
    """
    return [*_software(), *_hardware(), *_places(data), *_extras(), *_optional_files()]


def _software() -> Iterator[Finding]:
    yield Finding("readygo", True, f"{readygo.__version__}, Python {platform.python_version()}, {platform.platform()}")
    for package in PACKAGES:
        try:
            yield Finding(package, True, importlib.metadata.version(package))
        except importlib.metadata.PackageNotFoundError:
            yield Finding(package, False, "not installed; install readygo again")


def _hardware() -> Iterator[Finding]:
    usable = available_cores()
    yield Finding("cores", None, f"{usable} of {os.cpu_count()} may be used; {usable} workers at most are of use")
    memory_gb = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    yield Finding("memory", None, f"{memory_gb:.1f} GB")
    yield Finding("SIMD", None, _simd())
    yield Finding("GPU", None, _gpu())


def _simd() -> str:
    from llvmlite.binding import get_host_cpu_features, get_host_cpu_name

    features = get_host_cpu_features()
    wide = [name for name in ("avx512f", "avx2", "neon") if features.get(name)]
    return f"{wide[0] if wide else 'none of AVX2, AVX-512 and NEON: slow'} ({get_host_cpu_name()})"


def _gpu() -> str:
    program = shutil.which("nvidia-smi")
    if program is None:
        return "none found (no nvidia-smi); everything works without one"
    command = [program, "--query-gpu=name,memory.total,driver_version", "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return "nvidia-smi is there, but does not answer"
    return "; ".join(done.stdout.strip().splitlines()) or "none"


def _places(data: Path) -> Iterator[Finding]:
    try:
        yield Finding("cache", True, f"{cache_folder('kernels').parent} can be written (XDG_CACHE_HOME moves it)")
    except ReadygoError as error:
        yield Finding("cache", False, str(error))
    for name, folder in (("disk of data", data.absolute()), ("disk of cache", cache_root())):
        there = next(place for place in (folder, *folder.parents) if place.exists())
        free_gb = shutil.disk_usage(there).free / 1e9
        yield Finding(name, free_gb > FREE_MIN_GB, f"{free_gb:.1f} GB free at {there}")
    yield Finding("loopback ports", *_ports())


def _ports() -> tuple[bool, str]:
    try:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
    except OSError as error:
        return False, f"none can be opened: {error.strerror}"
    try:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", ROUTER_PORT))
    except OSError:
        return True, f"can be opened; {ROUTER_PORT} is in use, choose another for --listen"
    return True, f"can be opened; {ROUTER_PORT} is free for --listen tcp/127.0.0.1:{ROUTER_PORT}"


def _extras() -> Iterator[Finding]:
    for extra, (package, purpose) in EXTRAS.items():
        there = importlib.util.find_spec(package) is not None
        how = f"{package} {_version(package)}" if there else f"not installed; {install_command(extra)}"
        yield Finding(f"extra {extra}", True if there else None, f"{purpose}: {how}")


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _optional_files() -> Iterator[Finding]:
    """Findings on files that readygo may not ship because of their licenses; commands take them as arguments."""
    yield Finding("SMPL model", None, "optional; `readygo avatar import --smpl FILE` takes one")
    yield Finding("PriorMDM", None, "optional; [animator] of a run's settings names code and checkpoint")
