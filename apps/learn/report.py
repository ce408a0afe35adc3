"""The report of a run: one HTML file that opens without a network."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from readygo.apps.learn.report_content import Command, ReportContent, RunNumbers, Score
from readygo.apps.pages.charts import line_chart, rate_bar, share_bar
from readygo.apps.pages.page import chart_figure, figure, jpeg_source, page, percent, png_source, table, webp_source
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
_END_NAMES = ("black", "orange", "blue", "pink")


def write_report(path: Path, content: ReportContent) -> None:
    """Write a self-contained HTML report.

    Images, charts, the film and the style are inside of the file; it has no scripts and asks no server for anything.
    The file appears under its final name only when it is complete.

    Args:
        path: The HTML file.
        content: What to show; see `ReportContent`.
    """
    write_whole(path, report_html(content))


def report_html(content: ReportContent) -> str:
    """The report as HTML text."""
    sections: list[tuple[str, Callable[[ReportContent], str]]] = [
        ("The place", _place),
        ("What the robot sees", _camera),
        ("Results in closed loop", _results),
        ("How it learned", _training),
        ("What it fails in", _failures),
        ("The data run", _run),
        ("How this was made", lambda c: _commands(c.commands)),
        ("Next: your own place", lambda c: _commands(c.next_steps)),
    ]
    return page(
        content.title,
        content.subtitle,
        tiles=_tiles(content),
        sections=[(heading, draw(content)) for heading, draw in sections],
        facts=content.provenance,
    )


def _tiles(content: ReportContent) -> list[tuple[str, str]]:
    facts: list[tuple[str, str]] = []
    if content.run:
        facts.append((f"{content.run.episodes:,}", "episodes recorded"))
        facts.append((f"{content.run.samples:,}", "samples"))
        facts.append((f"{content.run.samples_per_s:,.1f}", "samples per second"))
    for score in content.scores:
        if score.driver == "policy":
            facts.append((f"{100 * score.summary.success_rate:.0f} %", f"policy's success, {score.task}"))
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
    labels = ", ".join(episode.label for episode in content.episodes if episode.label)
    ways = f"{len(content.episodes)} episodes: robot in blue from dot to green goal, people in warm colours"
    return f"{note} and {ways} ({labels})." if labels else f"{note} and {ways}."


def _camera(content: ReportContent) -> str:
    images = "".join(
        figure(jpeg_source(image.rgb), f"{image.time_s:.2f} s", alt=f"Robot's view after {image.time_s:.2f} s")
        for image in content.strip
    )
    strip = f'<div class="strip">{images}</div>' if images else ""
    note = f'<p class="note">{escape(content.strip_note)}</p>' if content.strip_note else ""
    video = f'<p class="note">As a video: {escape(content.video.name)}, beside this page.</p>' if content.video else ""
    return strip + note + video


def _results(content: ReportContent) -> str:
    if not content.scores:
        return ""
    head = (
        "<tr><th>Task</th><th>Driver</th><th class=n>Success</th><th>95 % interval</th><th></th>"
        "<th class=n>Reaching time</th><th class=n>SPL</th><th class=n>Hit a person</th>"
        "<th class=n>Hit a thing</th><th class=n>Too late</th><th class=n>n</th></tr>"
    )
    scores = table(head, "".join(_score_row(score) for score in content.scores))
    note = (
        "Success: within 1 m of the goal, no collision, in time. Intervals are Wilson's. The reaching time is the mean "
        "over all episodes, a failed one counting as the time limit; SPL is success weighted by path length. "
    )
    return scores + f'<p class="note">{escape(note + content.scores_note)}</p>'


def _score_row(score: Score) -> str:
    s = score.summary
    low, high = s.success_rate_low, s.success_rate_high
    return (
        f"<tr><td>{escape(score.task)}</td><td>{escape(score.driver)}</td>"
        f"<td class=n><b>{percent(s.success_rate)}</b></td><td>{percent(low)} to {percent(high)}</td>"
        f"<td>{rate_bar(s.success_rate, low, high)}</td><td class=n>{s.art_s:.1f} s</td><td class=n>{s.spl:.2f}</td>"
        f"<td class=n>{percent(s.human_collision_rate)}</td><td class=n>{percent(s.static_collision_rate)}</td>"
        f"<td class=n>{percent(s.timeout_rate)}</td><td class=n>{s.episode_count:,}</td></tr>"
    )


def _training(content: ReportContent) -> str:
    rates = {"minutes": content.rates, "samples learned from": content.rates_by_samples}
    charts = [
        (
            line_chart(curves, x_name=x_name, what="Success", y_max=100.0),
            f"Success [%] on the split val over {x_name}.",
        )
        for x_name, curves in rates.items()
    ]
    charts.append((line_chart(content.losses, x_name="samples learned from"), "Loss in training."))
    note = f'<p class="note">{escape(content.training_note)}</p>' if content.training_note else ""
    return "".join(chart_figure(svg, caption) for svg, caption in charts if svg) + note


def _failures(content: ReportContent) -> str:
    parts = []
    if any(len(ends.xy_m) for ends in content.ends) and (content.occupancy or content.top_view):
        parts.append(figure(png_source(_ends(content)), _ends_note(content), alt="Map of the places of failure"))
    for film in content.films:
        parts.append(f'<div class="film">{figure(webp_source(film.path), film.note, alt=film.note)}</div>')
    return "".join(parts)


def _ends(content: ReportContent) -> Picture:
    view = _plan(content)
    picture = view.rgb.copy()
    for ends, colour in zip(content.ends, _END_COLOURS, strict=False):
        for xy_m in ends.xy_m:
            draw_disc(picture, view, xy_m, 0.12, colour)
    return picture


def _ends_note(content: ReportContent) -> str:
    kinds = [f"{ends.name} {len(ends.xy_m)} ({colour})" for ends, colour in zip(content.ends, _END_NAMES, strict=False)]
    return f"Where it failed: {', '.join(kinds)}. {content.ends_note}".strip()


def _run(content: ReportContent) -> str:
    run = content.run
    if run is None:
        return ""
    text = (
        f"{run.episodes:,} episodes with {run.samples:,} samples in {run.wall_s:,.0f} s: "
        f"{run.samples_per_s:,.1f} samples per second."
    )
    return f"<p>{escape(text)}</p><div class=pair>{_cpu_table(run)}{_rejected_table(run)}</div>"


def _cpu_table(run: RunNumbers) -> str:
    total = sum(run.cpu_s_by_stage.values())
    rows = "".join(
        f"<tr><td>{escape(stage)}</td><td class=n>{seconds:,.1f} s</td>"
        f"<td class=n>{1e3 * seconds / max(run.samples, 1):,.2f} ms</td>"
        f"<td>{share_bar(seconds / max(total, 1e-9))}</td></tr>"
        for stage, seconds in run.cpu_s_by_stage.items()
    )
    head = "<tr><th>Stage</th><th class=n>CPU time</th><th class=n>per sample</th><th></th></tr>"
    return table(head, rows) if rows else ""


def _rejected_table(run: RunNumbers) -> str:
    tried = run.episodes + sum(run.rejected.values())
    rows = "".join(
        f"<tr><td class=wide>{escape(reason)}</td><td class=n>{count:,}</td>"
        f"<td class=n>{percent(count / tried)}</td></tr>"
        for reason, count in sorted(run.rejected.items(), key=lambda item: (-item[1], item[0]))
    )
    head = f"<tr><th>Not recorded, of {tried:,} tried</th><th class=n>Episodes</th><th class=n>Share</th></tr>"
    return table(head, rows or "<tr><td>none</td><td class=n>0</td><td class=n>0 %</td></tr>")


def _commands(commands: Sequence[Command]) -> str:
    return "".join(
        f"<div class=what>{escape(command.what)}</div><pre><code>{escape(command.line)}</code></pre>"
        for command in commands
    )
