"""The `readygo` command: finds the command's function, reads its arguments with tyro, turns mistakes into one line."""

import importlib
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

# One numba and BLAS thread per process: the fleet is parallel by processes. Set before NumPy is imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

USER_MISTAKE = 2
INTERRUPTED = 130

COMMANDS: Mapping[str, tuple[str, str]] = {
    "demo": ("readygo.apps.demo.demo:demo", "run the whole job on the embedded scene and write a report"),
    "scene import": ("readygo.apps.commands.scene:scene_import", "make a scene bundle of a Gaussian file"),
    "scene inspect": ("readygo.apps.commands.scene:scene_inspect", "measure a scene bundle and draw it from above"),
    "avatar list": ("readygo.apps.commands.avatar:avatar_list", "list the people that can walk through scenes"),
    "avatar import": (
        "readygo.apps.commands.avatar_import:avatar_import",
        "make an avatar of a HUGS, SMPL, glTF or Gaussian file",
    ),
    "avatar preview": (
        "readygo.apps.commands.avatar:avatar_preview",
        "draw a person from all sides, or film them walking",
    ),
    "plan": (
        "readygo.apps.commands.plan:plan",
        "plan one episode again and explain it in numbers, a picture or a film",
    ),
    "generate": ("readygo.apps.commands.generate:generate", "record episodes of an expert among walking people"),
    "validate": ("readygo.apps.commands.data:validate", "read a dataset again and report every defect"),
    "inspect": ("readygo.apps.commands.data:inspect", "say what a dataset holds"),
    "coverage": (
        "readygo.apps.commands.coverage:coverage",
        "show what a dataset covers, and what it does not, on one page",
    ),
    "train": ("readygo.apps.commands.train:train", "learn a policy from recorded episodes"),
    "evaluate": ("readygo.apps.commands.evaluate:evaluate", "measure success rates in closed loop"),
    "worker": ("readygo.apps.fleet.worker:worker", "join a fleet as one worker"),
    "bench render": (
        "readygo.benchmarks.rasterizer.render:bench_render",
        "measure images per second, beside the bound and a peer",
    ),
    "bench motion": (
        "readygo.benchmarks.motion.gates:bench_motion",
        "measure how human the gait is, against its gates",
    ),
    "bench plan": (
        "readygo.benchmarks.planning.plan:bench_plan",
        "measure success, times and smoothness of the robot experts",
    ),
    "warm": ("readygo.apps.commands.warm:warm", "compile all kernels once"),
}
"""Command -> (where its function is, what it does)."""


def main() -> None:
    """Run a command; a user's mistake prints one line and exits with 2, Ctrl-C exits with 130."""
    from readygo.common.errors import ReadygoError

    try:
        run(sys.argv[1:])
    except ReadygoError as error:
        _stop(str(error), USER_MISTAKE)
    except OSError as error:
        _stop(f"{error.strerror or error}{f': {error.filename}' if error.filename else ''}.", USER_MISTAKE)
    except KeyboardInterrupt:
        _stop("stopped; what is recorded or saved stays, run the same command again to go on.", INTERRUPTED)


def run(argv: list[str]) -> None:
    """Run the command that `argv` names."""
    import tyro

    for words in (2, 1):
        name = " ".join(argv[:words])
        if name in COMMANDS:
            tyro.cli(_function(COMMANDS[name][0]), prog=f"readygo {name}", args=argv[words:])
            return
    asked_for_help = not argv or argv[0] in ("-h", "--help")
    group = {name: command for name, command in COMMANDS.items() if argv and name.startswith(f"{argv[0]} ")}
    if asked_for_help or group:
        _print_commands(group or COMMANDS)
    if not asked_for_help:
        _stop(f"unknown command {' '.join(argv[:2])!r}; see `readygo --help`.", USER_MISTAKE)


def _function(path: str) -> Callable[..., Any]:
    module, name = path.split(":")
    function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function


def _print_commands(commands: Mapping[str, tuple[str, str]]) -> None:
    width = max(len(name) for name in commands)
    lines = ["usage: readygo COMMAND ..., or readygo COMMAND --help", ""]
    lines += [f"  {name:<{width}}  {text}" for name, (_, text) in commands.items()]
    sys.stdout.write("\n".join(lines) + "\n")


def _stop(message: str, code: int) -> None:
    sys.stderr.write(f"readygo: {message}\n")
    raise SystemExit(code)
