"""Settings of `readygo learn`: the section `[learn]` of a configuration file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from readygo.common.config import Range, check_ranges
from readygo.common.images.names import RGB
from readygo.common.policy.sight import check_images
from readygo.runs.sections import with_file
from readygo.services.trainer import NetworkConfig

GoalName = Literal["point", "image", "both"]
TeacherName = Literal["rl", "expert", "expert-tracked"]
Share = Annotated[float, Range(low=0.0, high=1.0)]


@dataclass(frozen=True, kw_only=True)
class LearnConfig:
    """Settings of training; the other sections have those of robot and recording."""

    mix: Share = 0.8
    """Policy fraction: share of the episodes that the newest policy drives; the expert drives the others."""
    reuse: Annotated[float, Range(above=0.0)] = 4.0
    """How often training uses each recorded sample; it determines the split of the cores."""
    val_every: Annotated[float, Range(above=0.0, high=1.0)] = 0.1
    """Share of the budget from one measurement on the split val to the next."""
    val_share: Annotated[float, Range(above=0.0, high=0.5)] = 0.15
    """Most time that these measurements may take, as a share of the time between them."""
    patience: Share = 0.5
    """Training ends when the success rate has not risen for this share of the budget."""
    images: tuple[str, ...] = (RGB,)
    """Images that the policy uses and that are recorded, by names as in `readygo.common.policy.sight`."""

    goal: GoalName = "point"
    """Goal input of the policy, as in `NetworkConfig.goal`; goal images are recorded if the policy uses them."""
    memory: int | None = None
    """Numbers of the policy's memory, as in `NetworkConfig.memory_count`; by default as its recipe has it, and none
    in the form "paper"."""
    teacher: TeacherName = "rl"
    """What labels the samples: "rl", the policy on states that the form "paper" trains first or that `--teacher` names,
    and the expert where neither is there; "expert", always the expert; "expert-tracked", always the expert that knows
    people by tracks of simulated detections. With both, "paper" trains no policy on states."""

    def __post_init__(self) -> None:
        check_ranges(self)
        check_images(self.images)
        if self.goal != "point" and self.images != (RGB,):
            raise ValueError(f'goal "{self.goal}" goes with the rgb of one camera, got images {list(self.images)}.')
        if self.memory is not None:
            self._check_memory(self.memory)

    def _check_memory(self, memory: int) -> None:
        try:
            NetworkConfig(goal=self.goal, memory_count=memory)
        except ValueError as error:
            raise ValueError(str(error).replace("memory_count", "memory")) from error


def load_learn_config(path: Path | None) -> LearnConfig:
    """The section `[learn]` of a configuration file; the defaults without one.

    Raises:
        ConfigError: If the file cannot be read, or the section holds an unknown key or a wrong value.
    """
    return with_file(LearnConfig(), path, table="learn")
