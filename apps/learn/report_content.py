"""What a report shows, as plain data."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from readygo.apps.pages.charts import Curve
from readygo.apps.pages.scores import Score
from readygo.common.drawing.plan_view import DrawnEpisode
from readygo.common.maps import OccupancyMap
from readygo.common.scenes.top_view import TopView


@dataclass(frozen=True, kw_only=True, eq=False)
class StripImage:
    """One image of the film strip."""

    rgb: npt.NDArray[np.uint8]
    """Shape (H, W, 3)."""
    time_s: float
    """Simulated time since the episode began [s]."""


@dataclass(frozen=True, kw_only=True)
class Film:
    """One episode as a film, embedded into the report."""

    path: Path
    """A .webm."""
    note: str
    """What it shows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """Where episodes ended in one way."""

    name: str
    """For example "hit a wall"."""
    xy_m: npt.NDArray[np.float64]
    """Robot's last places [m], shape (N, 2)."""


@dataclass(frozen=True, kw_only=True)
class RunNumbers:
    """What the generation run made and what it cost."""

    episodes: int
    samples: int
    images: int
    """Samples with an image, which training draws from."""
    learned: int
    """Samples that were learned from, repeats counted."""
    wall_s: float
    """Of the whole run, start and stop of its processes included [s]."""
    rejected: Mapping[str, int] = field(default_factory=dict)
    """Episodes that were not recorded, by reason."""
    cpu_s_by_stage: Mapping[str, float] = field(default_factory=dict)
    """CPU time per stage [s], in the order to be shown."""

    @property
    def samples_per_s(self) -> float:
        """Recorded samples per second of wall time."""
        return self.samples / self.wall_s if self.wall_s > 0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command line and what it does."""

    what: str
    line: str


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page beside the report."""

    href: str
    """From the report's folder."""
    what: str
    """What it shows."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportContent:
    """Everything in a report. Parts that are empty or None are left out."""

    title: str
    subtitle: str
    """What came out and what was done, in a few sentences."""
    hero: Film | None = None
    """What is seen first: best the policy that reaches its goal among humans."""
    scene_name: str
    scene_note: str = ""
    """For example size, number of Gaussians, license."""
    top_view: TopView | None = None
    occupancy: OccupancyMap | None = None
    episodes: tuple[DrawnEpisode, ...] = ()
    """Drawn on the map."""
    strip: tuple[StripImage, ...] = ()
    """Consecutive images of the robot's camera, best with a person who walks by."""
    strip_note: str = ""
    video: Path | None = None
    """A film beside the report, which links to it."""
    rates: tuple[Curve, ...] = ()
    """Success rates on the split val [%] over minutes."""
    rates_by_samples: tuple[Curve, ...] = ()
    """The same over samples learned from."""
    losses: tuple[Curve, ...] = ()
    """Over samples learned from."""
    training_note: str = ""
    ends: tuple[Ends, ...] = ()
    """Where the policy failed, by what happened."""
    ends_note: str = ""
    films: tuple[Film, ...] = ()
    """Of the policy, failing."""
    pages: tuple[Page, ...] = ()
    """Of the test episodes: where everybody went, and each failure."""
    scores: tuple[Score, ...] = ()
    scores_note: str = ""
    run: RunNumbers | None = None
    commands: tuple[Command, ...] = ()
    """The commands that made what the report shows."""
    next_steps: tuple[Command, ...] = ()
    """What to run next on one's own scene."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """For the footer: versions, commit, hashes, numeric class, machine."""
