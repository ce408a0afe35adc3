"""What drivers of a benchmark are given besides their goal, and what they have learned from: columns of its table."""

import dataclasses
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import load_perception_spec
from readygo.common.policy import load_spec
from readygo.common.state_policy.state_policy import load_state_policy
from readygo.runs.methods import (
    EXPERT_TRACKED,
    NETWORKS,
    PERCEIVE_AND_ACT,
    PERCEIVE_AND_PLAN,
    PERCEPTION,
    RL,
    network_of,
    other_policies,
    state_policies,
)
from readygo.runs.origin import DataOrigin, origin_of_perception, origin_of_policy
from readygo.services.evaluator import EXPERT, STRAIGHT_LINE, stated_training


@dataclass(frozen=True, kw_only=True)
class DriverInputs:
    """What a driver is given, and what it has learned from."""

    map: bool = False
    """True if it knows the scene's map and its place on it."""
    people: str = ""
    """Which people it is told of; empty if it has to find them in its images, or knows of none."""
    images: tuple[str, ...] = ()
    """Images of its cameras that it uses."""
    trained_on: str | None = ""
    """Scenes and people of its data; empty for drivers that learn nothing, None if that is not stated."""
    seen: tuple[str, ...] | None = ()
    """Scenes of the suite that its data are of; None if that is not stated."""

    @property
    def learns(self) -> bool:
        """True if it is stated that it has learned from something."""
        return bool(self.trained_on)


_FIXED = {
    STRAIGHT_LINE: DriverInputs(),
    "expert-blind": DriverInputs(map=True),
    EXPERT: DriverInputs(map=True, people="true, in view"),
    "expert-paper": DriverInputs(map=True, people="true, in view"),
    "expert-oracle": DriverInputs(map=True, people="true, all, and where they mean to walk"),
    EXPERT_TRACKED: DriverInputs(map=True, people="detected, in view"),
    "social-force": DriverInputs(map=True, people="true, all"),
    "gaussnav": DriverInputs(map=True),
    "splat-nav": DriverInputs(map=True),
}
"""Drivers that learn nothing. The map of `splat-nav` is made of the Gaussians."""
_NETWORK = DriverInputs(images=("rgb",), trained_on="logs of its authors, or a fine-tuning", seen=None)
_UNKNOWN = "unknown"
_PERCEIVING = (PERCEIVE_AND_PLAN, PERCEIVE_AND_ACT)


def inputs_of(driver: str, checkpoints: Path, scenes: Mapping[str, str]) -> DriverInputs:
    """What a driver is given.

    Args:
        driver: Name of the driver.
        checkpoints: Folder of weights and policies.
        scenes: Content hash of the suite's scenes, by name.

    Raises:
        PolicyError: If it is a policy that cannot be read.
        RunError: If it is a class that cannot be imported.
    """
    if driver in _FIXED:
        return _FIXED[driver]
    if network_of(driver):
        return _NETWORK
    if ":" in driver:
        return _inputs_of_class(driver)
    if driver in _PERCEIVING:
        return _inputs_of_perceiving(driver, checkpoints, scenes)
    for folder in state_policies([driver], checkpoints).values():
        trained = _training_of_state_policy(folder)
        return DriverInputs(
            map=True, people="detected, in view", trained_on=trained.words, seen=_seen(scenes, trained.scenes)
        )
    for folder in other_policies([driver], checkpoints).values():
        spec = load_spec(folder)
        trained = _training_of_data(origin_of_policy(spec))
        return DriverInputs(images=spec.images, trained_on=trained.words, seen=_seen(scenes, trained.scenes))
    return DriverInputs(images=("rgb",))


def unstated(driver: str, inputs: DriverInputs) -> DriverInputs:
    """What results of the first format say of a driver: of some kinds they do not state what it has learned from.

    Args:
        driver: Name of the driver.
        inputs: What it is given.
    """
    if driver in _PERCEIVING or network_of(driver) or ":" in driver or inputs.trained_on == _UNKNOWN:
        return dataclasses.replace(inputs, trained_on=None, seen=None)
    return inputs


def row_of(driver: str) -> str:
    """The row of the table that a driver belongs to: policies of several training seeds share the folder above them.

    Weights of a published network have a row for each folder below the network's name, such as `gnm/zero-shot`.
    """
    above = driver.rpartition("/")[0]
    return driver if ":" in driver or above in NETWORKS else above or driver


def check_names(drivers: Collection[str]) -> None:
    """Raise PolicyError for the name `policy`, which stands for no certain policy in a benchmark."""
    if "policy" in drivers:
        raise PolicyError(
            "The driver `policy` is no name for the table: put its folder into that of --checkpoints, and name it."
        )


@dataclass(frozen=True, kw_only=True)
class _Training:
    """What a network or policy has learned from."""

    words: str
    scenes: Collection[str] | None
    """Content hashes of its scenes; None if they are unknown."""


def _inputs_of_class(driver: str) -> DriverInputs:
    stated = stated_training(driver)
    return DriverInputs(images=("rgb",), trained_on=stated, seen=() if stated == "" else None)


def _inputs_of_perceiving(driver: str, checkpoints: Path, scenes: Mapping[str, str]) -> DriverInputs:
    try:
        parts = {"perception": _training_of_data(origin_of_perception(load_perception_spec(checkpoints / PERCEPTION)))}
        if driver == PERCEIVE_AND_ACT:
            parts["policy"] = _training_of_state_policy(checkpoints / RL)
    except PolicyError as error:
        raise PolicyError(f"The driver {driver}: {error}") from error
    known = [trained.scenes for trained in parts.values()]
    seen = None if None in known else _seen(scenes, {scene for each in known for scene in each or ()})
    words = "; ".join(f"{trained.words} ({part})" for part, trained in parts.items())
    return DriverInputs(map=True, images=("rgb",), trained_on=words, seen=seen)


def _training_of_state_policy(folder: Path) -> _Training:
    trained = load_state_policy(folder).spec.scenes
    return _Training(words=", ".join(name or sha256[:12] for sha256, name in trained.items()), scenes=trained.keys())


def _training_of_data(origin: DataOrigin | None) -> _Training:
    if origin is None:
        return _Training(words=_UNKNOWN, scenes=None)
    people = f"{len(origin.avatars)} people" if origin.avatars else "no people"
    return _Training(words=f"{', '.join(origin.scenes.values())}; {people}", scenes=origin.scenes.keys())


def _seen(scenes: Mapping[str, str], trained: Collection[str] | None) -> tuple[str, ...] | None:
    return None if trained is None else tuple(name for name, sha256 in scenes.items() if sha256 in trained)
