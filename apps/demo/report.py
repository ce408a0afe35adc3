"""The report of a run: one HTML file that opens without a network."""

import base64
import os
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

import cv2
import numpy as np

from apps.demo.charts import loss_chart, rate_bar, share_bar
from apps.demo.plan_view import INK, Picture, draw_episodes, draw_path, faded, map_view, put_text, resized
from apps.demo.report_content import Command, ReportContent, RunNumbers, Score
from apps.demo.report_style import REPORT_CSS
from common.scenes.top_view import TopView

_PLAN_HEIGHT_PX = 760


def write_report(path: Path, content: ReportContent) -> None:
    """Write a self-contained HTML report.

    Images, charts, the film and the style are inside of the file; it has no scripts and asks no server for anything.
    The file appears under its final name only when it is complete.

    Args:
        path: The HTML file.
        content: What to show; see `ReportContent`.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        unfinished.write_text(report_html(content), encoding="utf-8")
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def report_html(content: ReportContent) -> str:
    """The report as HTML text."""
    sections: list[tuple[str, Callable[[ReportContent], str]]] = [
        ("The place", _place),
        ("What the robot sees", _camera),
        ("Results in closed loop", _results),
        ("Training", _training),
        ("The data run", _run),
        ("How this was made", lambda c: _commands(c.commands)),
        ("Next: your own place", lambda c: _commands(c.next_steps)),
    ]
    bodies = [(heading, draw(content)) for heading, draw in sections]
    shown = "".join(f"<section><h2>{escape(heading)}</h2>{body}</section>" for heading, body in bodies if body)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(content.title)}</title><style>{REPORT_CSS}</style></head><body><main>"
        f"<header><h1>{escape(content.title)}</h1><p>{escape(content.subtitle)}</p>{_tiles(content)}</header>"
        f"{shown}{_footer(content)}</main></body></html>\n"
    )


def _tiles(content: ReportContent) -> str:
    facts: list[tuple[str, str]] = []
    if content.run:
        facts.append((f"{content.run.episodes:,}", "episodes recorded"))
        facts.append((f"{content.run.samples:,}", "samples"))
        facts.append((f"{content.run.samples_per_s:,.1f}", "samples per second"))
    for score in content.scores:
        if score.driver == "policy":
            facts.append((f"{100 * score.summary.success_rate:.0f} %", f"policy's success, {score.task}"))
    tiles = "".join(f"<li><b>{escape(value)}</b>{escape(name)}</li>" for value, name in facts)
    return f'<ul class="tiles">{tiles}</ul>' if tiles else ""


def _place(content: ReportContent) -> str:
    figures = []
    if content.top_view:
        view = resized(content.top_view, _PLAN_HEIGHT_PX)
        picture = view.rgb.copy()
        _scale_bar(picture, view)
        note = f"{content.scene_name} from above, ceiling removed. {content.scene_note}"
        figures.append(_figure(_jpeg(picture), note, alt="The scene from above"))
    if content.occupancy or (content.top_view and content.episodes):
        figures.append(
            _figure(_png(_paths(content)), _paths_note(content), alt="Map with the ways of robot and people")
        )
    return f'<div class="pair">{"".join(figures)}</div>' if figures else ""


def _paths(content: ReportContent) -> Picture:
    if content.occupancy:
        view = resized(map_view(content.occupancy), _PLAN_HEIGHT_PX)
    else:
        assert content.top_view
        view = faded(resized(content.top_view, _PLAN_HEIGHT_PX), 0.5)
    return draw_episodes(view, content.episodes)


def _paths_note(content: ReportContent) -> str:
    note = "What blocks the robot (grey)" if content.occupancy else "The scene"
    if not content.episodes:
        return note + "."
    labels = ", ".join(episode.label for episode in content.episodes if episode.label)
    ways = f"{len(content.episodes)} episodes: robot in blue from dot to green goal, people in warm colours"
    return f"{note} and {ways} ({labels})." if labels else f"{note} and {ways}."


def _scale_bar(picture: Picture, view: TopView) -> None:
    frame = view.frame
    x, y = frame.origin_x_m + 16 * frame.resolution_m, frame.origin_y_m + 16 * frame.resolution_m
    metre = np.array([[x, y], [x + 1.0, y]])
    draw_path(picture, view, metre, (255, 255, 255), width_px=7)
    draw_path(picture, view, metre, INK, width_px=3)
    u, v = view.world_to_pixel(metre[1])
    put_text(picture, "1 m", (int(u) + 8, int(v) + 5), size=0.5)


def _camera(content: ReportContent) -> str:
    images = "".join(
        _figure(_jpeg(image.rgb), f"{image.time_s:.2f} s", alt=f"Robot's view after {image.time_s:.2f} s")
        for image in content.strip
    )
    strip = f'<div class="strip">{images}</div>' if images else ""
    note = f'<p class="note">{escape(content.strip_note)}</p>' if content.strip_note else ""
    return strip + note + _film(content)


def _film(content: ReportContent) -> str:
    if content.animation is None:
        return ""
    data = base64.b64encode(content.animation.read_bytes()).decode("ascii")
    note = "One episode: the robot's view beside the scene from above; person, goal and ways in the colours of the map."
    if content.video:
        note += f" As a video: {content.video.name}, beside this page."
    return f'<div class="film">{_figure(f"data:image/webp;base64,{data}", note, alt="One episode as a film")}</div>'


def _results(content: ReportContent) -> str:
    if not content.scores:
        return ""
    head = (
        "<tr><th>Task</th><th>Driver</th><th class=n>Success</th><th>95 % interval</th><th></th>"
        "<th class=n>Reaching time</th><th class=n>SPL</th><th class=n>Hit a person</th>"
        "<th class=n>Hit a thing</th><th class=n>Too late</th><th class=n>n</th></tr>"
    )
    table = _table(head, "".join(_score_row(score) for score in content.scores))
    note = (
        "Success: within 1 m of the goal, no collision, in time. Intervals are Wilson's. The reaching time is the mean "
        "over all episodes, a failed one counting as the time limit; SPL is success weighted by path length. "
    )
    return table + f'<p class="note">{escape(note + content.scores_note)}</p>'


def _score_row(score: Score) -> str:
    s = score.summary
    low, high = s.success_rate_low, s.success_rate_high
    return (
        f"<tr><td>{escape(score.task)}</td><td>{escape(score.driver)}</td>"
        f"<td class=n><b>{_percent(s.success_rate)}</b></td><td>{_percent(low)} to {_percent(high)}</td>"
        f"<td>{rate_bar(s.success_rate, low, high)}</td><td class=n>{s.art_s:.1f} s</td><td class=n>{s.spl:.2f}</td>"
        f"<td class=n>{_percent(s.human_collision_rate)}</td><td class=n>{_percent(s.static_collision_rate)}</td>"
        f"<td class=n>{_percent(s.timeout_rate)}</td><td class=n>{s.episode_count:,}</td></tr>"
    )


def _training(content: ReportContent) -> str:
    chart = loss_chart(content.losses, step_name=content.loss_step_name)
    note = f'<p class="note">{escape(content.training_note)}</p>' if content.training_note else ""
    return chart + note


def _run(content: ReportContent) -> str:
    run = content.run
    if run is None:
        return ""
    text = (
        f"{run.episodes:,} episodes with {run.samples:,} samples in {run.wall_s:,.0f} s by {run.workers} workers: "
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
    return _table(head, rows) if rows else ""


def _rejected_table(run: RunNumbers) -> str:
    tried = run.episodes + sum(run.rejected.values())
    rows = "".join(
        f"<tr><td class=wide>{escape(reason)}</td><td class=n>{count:,}</td>"
        f"<td class=n>{_percent(count / tried)}</td></tr>"
        for reason, count in sorted(run.rejected.items(), key=lambda item: (-item[1], item[0]))
    )
    head = f"<tr><th>Not recorded, of {tried:,} tried</th><th class=n>Episodes</th><th class=n>Share</th></tr>"
    return _table(head, rows or "<tr><td>none</td><td class=n>0</td><td class=n>0 %</td></tr>")


def _commands(commands: Sequence[Command]) -> str:
    return "".join(
        f"<div class=what>{escape(command.what)}</div><pre><code>{escape(command.line)}</code></pre>"
        for command in commands
    )


def _footer(content: ReportContent) -> str:
    facts = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in content.provenance.items())
    return f"<footer><dl>{facts}</dl></footer>" if facts else ""


def _table(head: str, rows: str) -> str:
    return f'<div class="scroll"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'


def _figure(source: str, caption: str, *, alt: str) -> str:
    return f'<figure><img src="{source}" alt="{escape(alt)}"><figcaption>{escape(caption)}</figcaption></figure>'


def _percent(rate: float) -> str:
    return f"{100 * rate:.0f} %"


def _jpeg(rgb: Picture) -> str:
    return _data_uri(rgb, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 90])


def _png(rgb: Picture) -> str:
    return _data_uri(rgb, ".png", [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _data_uri(rgb: Picture, suffix: str, options: list[int]) -> str:
    done, data = cv2.imencode(suffix, np.ascontiguousarray(rgb[..., ::-1]), options)
    assert done
    kind = "jpeg" if suffix == ".jpg" else "png"
    return f"data:image/{kind};base64,{base64.b64encode(data.tobytes()).decode('ascii')}"
