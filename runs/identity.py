"""Identity of a run, independent of its machines: settings that determine its samples, and metadata of its shards."""

import hashlib
import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from readygo.common.dataset.provenance import AvatarOrigin, Provenance, ScenarioOrigin, SceneOrigin
from readygo.common.errors import PolicyError, RunError
from readygo.common.extras import ROOT, install_command
from readygo.common.messages import PolicyRef, RunSpec, TeacherRef, encode
from readygo.common.messages.stages import EXPERT_LINE
from readygo.common.rasterizer.backend_names import GPU_BACKENDS
from readygo.runs.config import RunConfig
from readygo.services.planner import text_hash

_NUMERIC_PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "opencv-python-headless")
NO_IDENTITY = ("recorder", "coordinator")
"""Sections of settings that do not affect samples."""


def identity(spec: RunSpec) -> dict[str, Any]:
    """The settings that determine a run's samples, as plain values: equal for runs with equal samples."""
    config = {name: section for name, section in spec.config.items() if name not in NO_IDENTITY}
    stages = b"" if spec.stages == EXPERT_LINE else b"".join(map(encode, spec.stages))
    return {
        "scene": spec.scene_hash,
        "avatars": spec.avatar_hashes,
        "seed": spec.seed,
        "split": spec.split.value,
        "static": spec.static,
        "scenarios": text_hash(spec.scenarios) if spec.scenarios else "",
        "config": config,
        **({"stages": hashlib.sha256(stages).hexdigest()} if stages else {}),
        **({"policy": spec.policy.sha256, "mix": spec.policy.mix} if spec.policy else {}),
        **({"teacher": spec.teacher.name} if spec.teacher else {}),
    }


def run_name(spec: RunSpec) -> str:
    """A short name for the run on the bus, from its identity."""
    text = json.dumps(identity(spec), sort_keys=True)
    return f"run-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def numeric_class(config: RunConfig, policy: PolicyRef | None = None, teacher: TeacherRef | None = None) -> str:
    """Environment that determines the bits of a run's samples besides their key: backend, package versions, CPU.

    Args:
        config: All settings.
        policy: Policy that drives besides the expert; None without one. The runtime of its graphs counts as well.
        teacher: Teacher in the expert's place; None without one. NumPy's matrix products count as well.

    Raises:
        ReadygoError: If backend or policy cannot run on this machine.
    """
    from readygo.common.rasterizer.gpu.availability import device_class
    from readygo.common.simd.types import fuses_multiply_adds

    architecture = f"{platform.machine()}{'' if fuses_multiply_adds() else '-without-fma'}"
    versions = [f"{name}-{importlib.metadata.version(name)}" for name in _NUMERIC_PACKAGES]
    backend = config.renderer.backend
    devices = [device_class(backend)] if backend in GPU_BACKENDS else []
    if config.animator.source == "priormdm":
        # Imported here: it loads torch.
        from readygo.services.animator import device_numeric_class

        devices.append(device_numeric_class(config.animator.priormdm))
    if policy is not None:
        versions.append(_onnxruntime_class())
    if teacher is not None:
        versions.append("-".join(["blas", *_wide_instructions()]))
    return " ".join([backend, *devices, architecture, *versions])


def check_same_make(spec: RunSpec, config: RunConfig) -> None:
    """Check that this installation reproduces the run's samples, before files are fetched or work is claimed.

    Raises:
        RunError: If it has a different version of readygo, or a different numeric class.
    """
    check_version(spec)
    theirs, mine = Provenance.of_run(spec).numeric_class, numeric_class(config, spec.policy, spec.teacher)
    if theirs not in ("", mine):
        raise RunError(
            f"The run's samples are of the numeric class {theirs!r}, this machine's would be of {mine!r}; "
            "install the versions that the run began with, or record into a new folder."
        )


def check_version(spec: RunSpec) -> None:
    """Check that a run was begun by this version of readygo.

    Raises:
        RunError: If it was begun by a different version.
    """
    theirs, ours = Provenance.of_run(spec).readygo_version, importlib.metadata.version("readygo")
    if theirs not in ("", ours):
        raise RunError(f"The run is of readygo {theirs}, this is {ours}: use the same version on all machines.")


def _onnxruntime_class() -> str:
    """Version of onnxruntime, and the CPU instructions that determine its kernels."""
    try:
        version = importlib.metadata.version("onnxruntime")
    except importlib.metadata.PackageNotFoundError as error:
        raise PolicyError(f"onnxruntime is not installed; run: {install_command('policy')}") from error
    return "-".join(["onnxruntime", version, *_wide_instructions()])


def _wide_instructions() -> list[str]:
    """Instructions of this CPU by which libraries choose their kernels."""
    from llvmlite.binding import get_host_cpu_features

    features = get_host_cpu_features()
    return [name for name in ("avx2", "avx512f", "avx512vnni", "amx-int8") if features.get(name)]


def run_metadata(
    config: RunConfig, *, scene: SceneOrigin, avatars: Mapping[str, AvatarOrigin], scenarios: ScenarioOrigin | None
) -> dict[str, Any]:
    """Metadata of the data besides settings and seed, as plain values."""
    made = Provenance(
        readygo_version=importlib.metadata.version("readygo"),
        commit=sources_commit(),
        numeric_class=numeric_class(config),
        scene=scene,
        avatars=avatars,
        scenarios=scenarios,
    )
    return made.to_mapping()


def sources_commit() -> str:
    """Commit of the sources; empty for an installed package."""
    if not (ROOT / ".git").exists():
        return ""
    done = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def files_of(spec: RunSpec) -> dict[str, Path]:
    """Files of a run that workers on other machines may lack, by hash, on the machine that began it."""
    scene = Path(spec.scene_path)
    files = {file.sha256: scene / file.path for file in spec.scene_files}
    if spec.avatar_files:
        place = Path(spec.avatars_path)
        files |= {file.sha256: place if place.is_file() else place / file.path for file in spec.avatar_files}
    if spec.policy is not None:
        files |= {file.sha256: Path(spec.policy.path) / file.path for file in spec.policy.files}
    if spec.teacher is not None:
        files |= {file.sha256: Path(spec.teacher.path) / file.path for file in spec.teacher.files}
    return files
