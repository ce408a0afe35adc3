"""Settings of `readygo learn` itself: the section `[learn]` of a configuration file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from readygo.apps.run.config import read_sections
from readygo.common.config import Range, check_ranges, section_from_mapping
from readygo.common.errors import ConfigError
from readygo.common.images.names import RGB
from readygo.common.policy.sight import check_images

GoalName = Literal["point", "image", "both"]
Share = Annotated[float, Range(low=0.0, high=1.0)]


@dataclass(frozen=True, kw_only=True)
class LearnConfig:
    """How a run learns; what is recorded, and with which robot, stands in the other sections."""

    mix: Share = 0.8
    """Share of the episodes that the newest policy drives, once there is one; the expert drives the others."""
    reuse: Annotated[float, Range(above=0.0)] = 4.0
    """How often a recorded sample is to be learned from: splits the cores between collecting and learning."""
    val_every: Annotated[float, Range(above=0.0, high=1.0)] = 0.1
    """Share of the budget from one measurement on the split val to the next."""
    val_share: Annotated[float, Range(above=0.0, high=0.5)] = 0.15
    """Most time that these measurements may take, as a share of the time between them."""
    val_episodes_max: Annotated[int, Range(low=1)] = 50
    """Most episodes per task of one measurement."""
    patience: Share = 0.5
    """It ends when the success rate has not risen for this share of the budget."""
    images: tuple[str, ...] = (RGB,)
    """What the policy sees, see `readygo.common.policy.sight`; these are recorded."""

    goal: GoalName = "point"
    """What it is told of the goal, see `NetworkConfig.goal`; images of goals are recorded where it sees them."""

    def __post_init__(self) -> None:
        check_ranges(self)
        check_images(self.images)
        if self.goal != "point" and self.images != (RGB,):
            raise ValueError(f'goal "{self.goal}" goes with the rgb of one camera, got images {list(self.images)}.')


def load_learn_config(path: Path | None) -> LearnConfig:
    """The section `[learn]` of a configuration file; the defaults without one.

    Raises:
        ConfigError: If the file cannot be read, or the section holds an unknown key or a wrong value.
    """
    section = read_sections(path).get("learn", {}) if path else {}
    if not isinstance(section, dict):
        raise ConfigError(f"Configuration {path}: learn must be a table, got {section!r}.")
    return section_from_mapping(LearnConfig, section, where="learn.")
