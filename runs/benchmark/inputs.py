"""What drivers of a benchmark are given besides their goal, and what they have learned from: columns of its table."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_spec
from readygo.common.state_policy.state_policy import load_state_policy
from readygo.runs.methods import (
    EXPERT_TRACKED,
    NETWORKS,
    PERCEIVE_AND_ACT,
    PERCEIVE_AND_PLAN,
    other_policies,
    state_policies,
)
from readygo.runs.origin import origin_of_policy
from readygo.services.evaluator import EXPERT, STRAIGHT_LINE


@dataclass(frozen=True, kw_only=True)
class DriverInputs:
    """What a driver is given, and what it has learned from."""

    map: bool = False
    """True if it knows the scene's map and its place on it."""
    people: str = ""
    """Which people it is told of; empty if it has to find them in its images, or knows of none."""
    images: tuple[str, ...] = ()
    """Images of its cameras that it uses."""
    trained_on: str = ""
    """Scenes and people of its data; empty for drivers that learn nothing."""
    seen: tuple[str, ...] = ()
    """Scenes of the suite that its data are of."""


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
    PERCEIVE_AND_PLAN: DriverInputs(map=True, images=("rgb",), trained_on="its network of perception"),
    PERCEIVE_AND_ACT: DriverInputs(map=True, images=("rgb",), trained_on="its network of perception and its policy"),
    **{name: DriverInputs(images=("rgb",), trained_on="logs of its authors, or a fine-tuning") for name in NETWORKS},
}
"""Drivers that are no policies. The map of `splat-nav` is made of the Gaussians."""


def inputs_of(driver: str, checkpoints: Path, scenes: Mapping[str, str]) -> DriverInputs:
    """What a driver is given.

    Args:
        driver: Name of the driver.
        checkpoints: Folder of weights and policies.
        scenes: Content hash of the suite's scenes, by name.

    Raises:
        PolicyError: If it is a policy that cannot be read.
    """
    for folder in state_policies([driver], checkpoints).values():
        state = load_state_policy(folder).spec
        return DriverInputs(
            map=True,
            people="detected, in view",
            trained_on=", ".join(name or sha256[:12] for sha256, name in state.scenes.items()),
            seen=_seen(scenes, state.scenes.keys()),
        )
    for folder in other_policies([driver], checkpoints).values():
        return _inputs_of_policy(load_spec(folder), scenes)
    return _FIXED.get(driver, DriverInputs(images=("rgb",)))


def row_of(driver: str) -> str:
    """The row of the table that a driver belongs to: policies of several training seeds share the folder above them."""
    return driver if ":" in driver else driver.rpartition("/")[0] or driver


def check_names(drivers: Collection[str]) -> None:
    """Raise PolicyError for the name `policy`, which stands for no certain policy in a benchmark."""
    if "policy" in drivers:
        raise PolicyError(
            "The driver `policy` is no name for the table: put its folder into that of --checkpoints, and name it."
        )


def _inputs_of_policy(spec: PolicySpec, scenes: Mapping[str, str]) -> DriverInputs:
    origin = origin_of_policy(spec)
    if origin is None:
        return DriverInputs(images=spec.images, trained_on="unknown")
    people = f"{len(origin.avatars)} people" if origin.avatars else "no people"
    return DriverInputs(
        images=spec.images,
        trained_on=f"{', '.join(origin.scenes.values())}; {people}",
        seen=_seen(scenes, origin.scenes.keys()),
    )


def _seen(scenes: Mapping[str, str], trained: Collection[str]) -> tuple[str, ...]:
    return tuple(name for name, sha256 in scenes.items() if sha256 in trained)
