"""Content of a report as plain data."""

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
    """Pixels, shape (H, W, 3)."""
    time_s: float
    """Simulated time since the episode began [s]."""


@dataclass(frozen=True, kw_only=True)
class Film:
    """Video of one episode, embedded into the report."""

    path: Path
    """Path of a .webm file."""
    note: str
    """Caption of the video."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """Final positions of episodes with the same kind of end."""

    name: str
    """Kind of end, for example "hit a wall"."""
    xy_m: npt.NDArray[np.float64]
    """Last positions of the robot [m], shape (N, 2)."""


@dataclass(frozen=True, kw_only=True)
class RunNumbers:
    """Numbers and times of the recording runs."""

    episodes: int
    samples: int
    images: int
    """Samples with an image, which training draws from."""
    learned: int
    """Samples that training has used, repeats counted."""
    wall_s: float
    """Wall time of the whole run, including start and stop of its processes [s]."""
    rejected: Mapping[str, int] = field(default_factory=dict)
    """Episodes that were not recorded, by reason."""
    cpu_s_by_stage: Mapping[str, float] = field(default_factory=dict)
    """CPU time per stage [s], in display order."""

    @property
    def samples_per_s(self) -> float:
        """Recorded samples per second of wall time."""
        return self.samples / self.wall_s if self.wall_s > 0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command line with a description."""

    what: str
    line: str


@dataclass(frozen=True, kw_only=True)
class Page:
    """A link to another page beside the report."""

    href: str
    """Path relative to the report's folder."""
    what: str
    """Text of the link."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportContent:
    """Everything in a report. Parts that are empty or None are left out."""

    title: str
    subtitle: str
    """Result and method in a few sentences."""
    hero: Film | None = None
    """Video at the top, preferably of the policy reaching its goal among humans."""
    scene_name: str
    scene_note: str = ""
    """Text about the scene, for example size, number of Gaussians, license."""
    top_view: TopView | None = None
    occupancy: OccupancyMap | None = None
    episodes: tuple[DrawnEpisode, ...] = ()
    """Episodes that are drawn on the map."""
    strip: tuple[StripImage, ...] = ()
    """Consecutive images of the robot's camera, preferably with a passing human."""
    strip_note: str = ""
    video: Path | None = None
    """Video beside the report, which links to it."""
    rates: tuple[Curve, ...] = ()
    """Success rates on the split val [%] over minutes."""
    rates_by_samples: tuple[Curve, ...] = ()
    """Success rates on the split val [%] over training samples."""
    losses: tuple[Curve, ...] = ()
    """Losses over training samples."""
    training_note: str = ""
    ends: tuple[Ends, ...] = ()
    """Places where the policy failed, by kind of failure."""
    ends_note: str = ""
    films: tuple[Film, ...] = ()
    """Videos of the policy's failures."""
    pages: tuple[Page, ...] = ()
    """Links to the pages of the test episodes: trajectories and failures."""
    scores: tuple[Score, ...] = ()
    scores_note: str = ""
    run: RunNumbers | None = None
    commands: tuple[Command, ...] = ()
    """The commands that produced the content of the report."""
    next_steps: tuple[Command, ...] = ()
    """Commands to run next, on the user's scene."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Provenance for the footer: versions, commit, hashes, numeric class, machine."""
