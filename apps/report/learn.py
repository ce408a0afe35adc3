"""The page of a learning run: results, failures, learning curves, data, commands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from readygo.apps.report.page import (
    Block,
    ColourLegend,
    CommandLine,
    MediaFigure,
    Meter,
    PageLink,
    PageTable,
    Paragraph,
    StripImage,
    arrange_blocks,
    drawing,
    image_strip,
    page,
    percent,
    photograph,
    rejections,
    small_print,
)
from readygo.apps.report.tables import DriverScore, success_rates
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.drawing.charts import Curve, line_chart
from readygo.common.drawing.plan_view import (
    HUMANS,
    INK,
    ROBOT,
    DrawnEpisode,
    Rgb,
    draw_disc,
    draw_episodes,
    draw_scale_bar,
    fade_view,
    map_view,
    resize_view,
)
from readygo.common.files import write_whole
from readygo.common.maps import OccupancyMap
from readygo.common.scenes.top_view import TopView

_PLAN_HEIGHT_PX = 760
_END_COLOURS: tuple[Rgb, ...] = (INK, HUMANS[0], ROBOT, HUMANS[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Ends:
    """Final positions of episodes with the same kind of end."""

    name: str
    """Kind of end, for example "hit a wall"."""
    xy_m: Float64Array
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


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportContent:
    """Everything in a report. Parts that are empty or None are left out."""

    title: str
    subtitle: str
    """Result and method in a few sentences."""
    hero: MediaFigure | None = None
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
    films: tuple[MediaFigure, ...] = ()
    """Videos of the policy's failures."""
    pages: tuple[PageLink, ...] = ()
    """Links to the pages of the test episodes: trajectories and failures."""
    scores: tuple[DriverScore, ...] = ()
    scores_note: str = ""
    run: RunNumbers | None = None
    commands: tuple[CommandLine, ...] = ()
    """The commands that produced the content of the report."""
    next_steps: tuple[CommandLine, ...] = ()
    """Commands to run next, on the user's scene."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Provenance for the footer: versions, commit, hashes, numeric class, machine."""


def write_report(path: Path, content: ReportContent) -> None:
    """Write the report as one HTML file, which appears under its final name only when it is complete.

    Args:
        path: The HTML file.
        content: Content of the report.

    Raises:
        ReadygoError: If the file cannot be written.
    """
    write_whole(path, report_html(content))


def report_html(content: ReportContent) -> str:
    """The report as HTML text."""
    return page(
        content.title,
        content.subtitle,
        hero=content.hero,
        tiles=_tiles(content),
        sections={
            "How well it drives": success_rates(content.scores, note=content.scores_note) if content.scores else [],
            "What it fails in": _failures(content),
            "How it learned": _training(content),
            "The place": _place(content),
            "What the robot sees": _camera(content),
            "The data run": _run(content.run) if content.run else [],
            "How this was made": content.commands,
            "Next: your own place": content.next_steps,
        },
        facts=content.provenance,
    )


def _tiles(content: ReportContent) -> list[tuple[str, str]]:
    tiles = [
        (percent(score.summary.success_rate), f"reaches its goal, {score.task}")
        for score in content.scores
        if score.driver == "policy"
    ]
    if content.run:
        tiles.append((f"{content.run.wall_s / 60:.0f} min", "of recording and learning"))
        tiles.append((f"{content.run.episodes:,}", "episodes recorded"))
        tiles.append((f"{content.run.samples:,}", "samples recorded"))
    return tiles


def _failures(content: ReportContent) -> list[Block]:
    blocks: list[Block] = []
    if any(len(ends.xy_m) for ends in content.ends) and (content.occupancy or content.top_view):
        coloured = list(zip(content.ends, _END_COLOURS, strict=False))
        legend = ColourLegend([(f"{ends.name} {len(ends.xy_m)}", colour) for ends, colour in coloured])
        picture = drawing(_draw_ends(content, coloured), content.ends_note, alt="Map of the places of failure")
        blocks += arrange_blocks("stack", [legend, picture])
    blocks = arrange_blocks("pair", [*blocks, *arrange_blocks("stack", content.films)])
    links = small_print("Test episodes, beside this page:", links=content.pages)
    return [*blocks, links] if content.pages else blocks


def _draw_ends(content: ReportContent, coloured: Sequence[tuple[Ends, Rgb]]) -> UInt8Array:
    view = _plan(content)
    picture = view.rgb.copy()
    for ends, colour in coloured:
        for xy_m in ends.xy_m:
            draw_disc(picture, view, xy_m, 0.16, colour)
    return picture


def _training(content: ReportContent) -> list[Block]:
    charts = {
        f"Success on the split val over {x_name}, with 95 % intervals.": line_chart(
            curves, x_name=x_name, what="Success [%]", y_max=100.0
        )
        for x_name, curves in (("minutes", content.rates), ("samples learned from", content.rates_by_samples))
    }
    caption = "What training minimises, and the squared error on held-out episodes."
    charts[caption] = line_chart(content.losses, x_name="samples learned from")
    figures = [MediaFigure(chart=svg, caption=caption) for caption, svg in charts.items() if svg]
    notes = [small_print(content.training_note)] if content.training_note else []
    return [*arrange_blocks("pair", figures), *notes]


def _place(content: ReportContent) -> list[Block]:
    blocks: list[Block] = []
    if content.top_view:
        view = resize_view(content.top_view, _PLAN_HEIGHT_PX)
        picture = view.rgb.copy()
        draw_scale_bar(picture, view)
        note = f"{content.scene_name} from above, ceiling removed. {content.scene_note}"
        blocks.append(photograph(picture, note, alt="The scene from above"))
    if content.occupancy or (content.top_view and content.episodes):
        picture = draw_episodes(_plan(content), content.episodes)
        blocks.append(drawing(picture, _paths_note(content), alt="Map with the paths of robot and humans"))
    return arrange_blocks("pair", blocks)


def _plan(content: ReportContent) -> TopView:
    if content.occupancy:
        return resize_view(map_view(content.occupancy), _PLAN_HEIGHT_PX)
    assert content.top_view
    return fade_view(resize_view(content.top_view, _PLAN_HEIGHT_PX), 0.5)


def _paths_note(content: ReportContent) -> str:
    note = "What blocks the robot (grey)" if content.occupancy else "The scene"
    if not content.episodes:
        return note + "."
    return f"{note} and {len(content.episodes)} episodes: robot in blue from dot to green goal, humans in warm colours."


def _camera(content: ReportContent) -> list[Block]:
    blocks = image_strip(content.strip)
    if content.strip_note:
        blocks.append(small_print(content.strip_note))
    if content.video:
        link = PageLink(href=content.video.name, what=content.video.name)
        blocks.append(small_print("As a video, beside this page:", links=[link]))
    return blocks


def _run(run: RunNumbers) -> list[Block]:
    text = (
        f"{run.episodes:,} episodes with {run.samples:,} samples recorded in {run.wall_s:,.0f} s: "
        f"{run.samples_per_s:,.1f} samples per second. {run.images:,} of them have an image; training drew from these, "
        f"each {run.learned / max(run.images, 1):.1f} times on average: {run.learned:,} samples learned from."
    )
    total_s = max(sum(run.cpu_s_by_stage.values()), 1e-9)
    rows: list[list[str | Block]] = [
        [stage, f"{seconds:,.1f} s", f"{1e3 * seconds / max(run.samples, 1):,.2f} ms", Meter(seconds / total_s)]
        for stage, seconds in run.cpu_s_by_stage.items()
    ]
    stages = PageTable(("Stage", "CPU time", "per sample", "share"), rows) if rows else None
    return [Paragraph(text=text), *arrange_blocks("pair", [stages, rejections(run.rejected, run.episodes)])]
