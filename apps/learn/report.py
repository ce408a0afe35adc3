"""The report of a run: one HTML file that opens without a network."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from readygo.apps.learn.report_content import Command, Ends, ReportContent, RunNumbers
from readygo.apps.pages.charts import line_chart, share_bar
from readygo.apps.pages.page import (
    Column,
    chart_figure,
    figure,
    film_figure,
    jpeg_source,
    legend,
    page,
    percent,
    png_source,
    rejections,
    table,
)
from readygo.apps.pages.scores import scores_section
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import (
    HUMANS,
    INK,
    ROBOT,
    Rgb,
    draw_disc,
    draw_episodes,
    draw_scale_bar,
    faded,
    map_view,
    resized,
)
from readygo.common.files import write_whole
from readygo.common.scenes.top_view import TopView

_PLAN_HEIGHT_PX = 760
_END_COLOURS: tuple[Rgb, ...] = (INK, HUMANS[0], ROBOT, HUMANS[1])


def write_report(path: Path, content: ReportContent) -> None:
    """Write a self-contained HTML report.

    The file contains images, charts, the video and the style; it has no scripts and makes no network requests. It
    appears under its final name only when it is complete.

    Args:
        path: The HTML file.
        content: Content of the report.
    """
    write_whole(path, report_html(content))


def report_html(content: ReportContent) -> str:
    """The report as HTML text."""
    sections: list[tuple[str, Callable[[ReportContent], str]]] = [
        ("How well it drives", _results),
        ("What it fails in", _failures),
        ("How it learned", _training),
        ("The place", _place),
        ("What the robot sees", _camera),
        ("The data run", _run),
        ("How this was made", lambda c: _commands(c.commands)),
        ("Next: your own place", lambda c: _commands(c.next_steps)),
    ]
    return page(
        content.title,
        content.subtitle,
        hero=_hero(content),
        tiles=_tiles(content),
        sections=[(heading, draw(content)) for heading, draw in sections],
        facts=content.provenance,
    )


def _hero(content: ReportContent) -> str:
    film = content.hero
    return f'<div class="hero">{film_figure(film.path, film.note, runs=True)}</div>' if film else ""


def _tiles(content: ReportContent) -> list[tuple[str, str]]:
    facts = [
        (percent(score.summary.success_rate), f"reaches its goal, {score.task}")
        for score in content.scores
        if score.driver == "policy"
    ]
    if content.run:
        facts.append((f"{content.run.wall_s / 60:.0f} min", "of recording and learning"))
        facts.append((f"{content.run.episodes:,}", "episodes recorded"))
        facts.append((f"{content.run.samples:,}", "samples recorded"))
    return facts


def _place(content: ReportContent) -> str:
    figures = []
    if content.top_view:
        view = resized(content.top_view, _PLAN_HEIGHT_PX)
        picture = view.rgb.copy()
        draw_scale_bar(picture, view)
        note = f"{content.scene_name} from above, ceiling removed. {content.scene_note}"
        figures.append(figure(jpeg_source(picture), note, alt="The scene from above"))
    if content.occupancy or (content.top_view and content.episodes):
        figures.append(
            figure(png_source(_paths(content)), _paths_note(content), alt="Map with the ways of robot and people")
        )
    return f'<div class="pair">{"".join(figures)}</div>' if figures else ""


def _paths(content: ReportContent) -> Picture:
    return draw_episodes(_plan(content), content.episodes)


def _plan(content: ReportContent) -> TopView:
    if content.occupancy:
        return resized(map_view(content.occupancy), _PLAN_HEIGHT_PX)
    assert content.top_view
    return faded(resized(content.top_view, _PLAN_HEIGHT_PX), 0.5)


def _paths_note(content: ReportContent) -> str:
    note = "What blocks the robot (grey)" if content.occupancy else "The scene"
    if not content.episodes:
        return note + "."
    return f"{note} and {len(content.episodes)} episodes: robot in blue from dot to green goal, people in warm colours."


def _camera(content: ReportContent) -> str:
    images = "".join(
        figure(jpeg_source(image.rgb), f"{image.time_s:.2f} s", alt=f"Robot's view after {image.time_s:.2f} s")
        for image in content.strip
    )
    strip = f'<div class="strip">{images}</div>' if images else ""
    note = f'<p class="note">{escape(content.strip_note)}</p>' if content.strip_note else ""
    return strip + note + (_video_link(content.video.name) if content.video else "")


def _video_link(name: str) -> str:
    return f'<p class="note">As a film, beside this page: <a href="{escape(quote(name))}">{escape(name)}</a>.</p>'


def _results(content: ReportContent) -> str:
    if not content.scores:
        return ""
    return scores_section(content.scores, note=content.scores_note)


def _training(content: ReportContent) -> str:
    rates = {"minutes": content.rates, "samples learned from": content.rates_by_samples}
    charts = [
        (
            line_chart(curves, x_name=x_name, what="Success [%]", y_max=100.0),
            f"Success on the split val over {x_name}.",
        )
        for x_name, curves in rates.items()
    ]
    loss = line_chart(content.losses, x_name="samples learned from")
    charts.append((loss, "What training makes small, and the squared error on episodes that are held out."))
    figures = "".join(chart_figure(svg, caption) for svg, caption in charts if svg)
    note = f'<p class="note">{escape(content.training_note)}</p>' if content.training_note else ""
    return (f'<div class="pair">{figures}</div>' if figures else "") + note


def _failures(content: ReportContent) -> str:
    films = "".join(film_figure(film.path, film.note) for film in content.films)
    parts = [f'<div class="stack">{films}</div>'] if films else []
    if any(len(ends.xy_m) for ends in content.ends) and (content.occupancy or content.top_view):
        kinds = [(f"{ends.name} {len(ends.xy_m)}", colour) for ends, colour in _coloured(content.ends)]
        places = figure(png_source(_ends(content)), content.ends_note, alt="Map of the places of failure")
        parts.insert(0, f"<div>{legend(kinds)}{places}</div>")
    shown = f'<div class="pair">{"".join(parts)}</div>' if parts else ""
    links = ", ".join(f'<a href="{escape(quote(page.href))}">{escape(page.what)}</a>' for page in content.pages)
    return shown + (f'<p class="note">Test episodes, beside this page: {links}.</p>' if links else "")


def _coloured(ends: Sequence[Ends]) -> list[tuple[Ends, Rgb]]:
    return list(zip(ends, _END_COLOURS, strict=False))


def _ends(content: ReportContent) -> Picture:
    view = _plan(content)
    picture = view.rgb.copy()
    for ends, colour in _coloured(content.ends):
        for xy_m in ends.xy_m:
            draw_disc(picture, view, xy_m, 0.16, colour)
    return picture


def _run(content: ReportContent) -> str:
    run = content.run
    if run is None:
        return ""
    text = (
        f"{run.episodes:,} episodes with {run.samples:,} samples recorded in {run.wall_s:,.0f} s: "
        f"{run.samples_per_s:,.1f} samples per second. {run.images:,} of them have an image; training drew from these, "
        f"each {run.learned / max(run.images, 1):.1f} times on average: {run.learned:,} samples learned from."
    )
    return f"<p>{escape(text)}</p><div class=pair>{_cpu_table(run)}{rejections(run.rejected, run.episodes)}</div>"


def _cpu_table(run: RunNumbers) -> str:
    total = max(sum(run.cpu_s_by_stage.values()), 1e-9)
    columns = (Column("Stage"), Column("CPU time", "n"), Column("per sample", "n"), Column("share"))
    rows = [
        [
            escape(stage),
            f"{seconds:,.1f} s",
            f"{1e3 * seconds / max(run.samples, 1):,.2f} ms",
            share_bar(seconds / total),
        ]
        for stage, seconds in run.cpu_s_by_stage.items()
    ]
    return table(columns, rows) if rows else ""


def _commands(commands: Sequence[Command]) -> str:
    return "".join(
        f"<div class=what>{escape(command.what)}</div><pre><code>{escape(command.line)}</code></pre>"
        for command in commands
    )
