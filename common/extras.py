"""Optional dependencies: the command that installs what is missing, from where this package came from."""

import importlib.metadata
import importlib.util
import shlex
import sys
from pathlib import Path
from typing import Literal

Extra = Literal[
    "policy",
    "train",
    "gpu",
    "reconstruct",
    "export",
    "record3d",
    "robot-logs",
    "tls",
    "monitor",
    "foxglove",
    "rerun",
    "metrics",
    "ray",
]
"""Names of the extras, as in pyproject.toml."""

ROOT = Path(__file__).resolve().parents[1]


def install_command(extra: Extra) -> str:
    """The command that adds an extra's packages to this environment; no package index knows readygo.

    Args:
        extra: Name of the extra.

    Returns:
        A line for the shell.
    """
    if (ROOT / "pyproject.toml").is_file():
        what = ["-e", f"{ROOT}[{extra}]", "-c", str(ROOT / "constraints.txt")]
    else:
        what = _requirements(extra)
    return shlex.join([sys.executable, "-m", "pip", "install", *what])


def is_installed(module: str) -> bool:
    """True if a module of an extra can be found, such as "prometheus_client"; it is not imported."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def _requirements(extra: str) -> list[str]:
    """What the extra needs, as the installed package says."""
    lines = importlib.metadata.requires("readygo") or []
    parts = [line.partition(";") for line in lines]
    return [what.strip() for what, _, condition in parts if f"extra == '{extra}'" in condition.replace('"', "'")]
