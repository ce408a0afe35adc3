"""Methods of an evaluation that are files: a resumed evaluation requires the same files on every machine."""

import hashlib
import importlib.util
from collections.abc import Sequence
from pathlib import Path

from readygo.common.errors import RunError
from readygo.common.files import open_regular
from readygo.common.perception.artifact import GRAPH_FILE, SPEC_FILE
from readygo.common.state_policy.state_policy import ACTOR_FILE, STATE_POLICY_FILE
from readygo.runs.methods import (
    PERCEIVE_AND_ACT,
    PERCEIVE_AND_PLAN,
    PERCEPTION,
    RL,
    network_file,
    network_of,
    other_policies,
    state_policies,
)
from readygo.runs.policy import policy_sha256


def method_hashes(methods: Sequence[str], checkpoints: Path) -> dict[str, str]:
    """SHA-256 of the weights of networks, of further policies, and of the files of a user's methods.

    A missing file has no hash; the function that makes the method reports it.

    Args:
        methods: Names of methods.
        checkpoints: Folder of weights and policies.
    """
    hashes = {method: _hash(method, checkpoints) for method in methods}
    return {method: sha256 for method, sha256 in hashes.items() if sha256}


def check_method_files(expected: dict[str, str], methods: Sequence[str], checkpoints: Path) -> None:
    """Check that the files of methods are the same as where their evaluation began.

    Raises:
        RunError: If a file is missing or different.
    """
    here = method_hashes(methods, checkpoints)
    for method, sha256 in expected.items():
        if here.get(method) != sha256:
            words = "is another one here" if method in here else "is not on this machine"
            raise RunError(
                f"The method {method} {words} than where the evaluation began; a scene and a policy travel to the "
                f"workers, methods do not: copy it, networks and policies to {checkpoints}."
            )


def _hash(method: str, checkpoints: Path) -> str:
    try:
        for folder in other_policies([method], checkpoints).values():
            return policy_sha256(folder)
        for folder in state_policies([method], checkpoints).values():
            return _files_hash([folder / STATE_POLICY_FILE, folder / ACTOR_FILE])
        if files := perception_files(method, checkpoints):
            return _files_hash(files)
        path = network_file(method, checkpoints) if network_of(method) else _source(method)
        return _file_hash(path) if path else ""
    except OSError:
        return ""


def perception_files(method: str, checkpoints: Path) -> list[Path]:
    """Files of the networks that a method perceives and acts by."""
    sees = [checkpoints / PERCEPTION / name for name in (SPEC_FILE, GRAPH_FILE)]
    acts = [checkpoints / RL / name for name in (STATE_POLICY_FILE, ACTOR_FILE)]
    return {PERCEIVE_AND_PLAN: sees, PERCEIVE_AND_ACT: [*sees, *acts]}.get(method, [])


def _source(method: str) -> Path | None:
    """The file of a user's method."""
    place, colon, _ = method.rpartition(":")
    if not colon:
        return None
    if place.endswith(".py"):
        return Path(place)
    try:
        spec = importlib.util.find_spec(place)
    except (ImportError, ValueError):
        return None
    return Path(spec.origin) if spec and spec.origin else None


def _files_hash(paths: Sequence[Path]) -> str:
    """SHA-256 of a file, or of those of several files."""
    hashes = [_file_hash(path) for path in paths]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


def _file_hash(path: Path) -> str:
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
