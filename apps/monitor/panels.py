"""The HTML panels beside the scene. Names, reasons and errors come from other processes: all text is escaped."""

import base64
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np

from readygo.apps.monitor.track import Pictures, Track, pictures_of, time_text
from readygo.apps.monitor.watch import RATE_WINDOW_S, Seen, Watch
from readygo.apps.pages.charts import Curve, line_chart
from readygo.apps.pictures.shades import shaded
from readygo.apps.pictures.side_by_side import caption_of, shown_images
from readygo.common.drawing.files import jpeg_bytes
from readygo.common.drawing.ticks import number_text
from readygo.common.images.files import decode_output
from readygo.common.images.names import RGB, kind_of
from readygo.common.messages import Outcome, RunSpec, StatusReply
from readygo.common.messages.live import LiveState
from readygo.common.robot import RobotConfig

BAR_COLOURS = ("#29a1ff", "#ffae34", "#78dc78", "#d678ff", "#ff6b6b", "#8fa3b8")
OUTCOME_COLOURS = {
    Outcome.SUCCESS: "#2fb67c",
    Outcome.STATIC_COLLISION: "#e5484d",
    Outcome.HUMAN_COLLISION: "#e5484d",
    Outcome.TIMEOUT: "#f5a623",
}
CSS = """
<style>
.rg { font: 13px/1.45 system-ui, "Segoe UI", Roboto, sans-serif; color: #e6e9ee; padding: 0 4px; }
.rg b { font-weight: 650; }
.rg .soft { color: #94a0ad; }
.rg .head { display: flex; align-items: center; gap: 8px; flex-wrap: wrap; margin: 2px 0 8px; }
.rg .name { font-size: 15px; font-weight: 650; letter-spacing: -0.01em; overflow-wrap: anywhere; }
.rg .badge { display: inline-flex; align-items: center; gap: 6px; padding: 1px 9px; border-radius: 99px;
  background: #2a2f36; font-size: 12px; }
.rg .badge i { width: 8px; height: 8px; border-radius: 50%; background: currentColor; }
.rg .live { color: #3ddc84; } .rg .live i { animation: rgp 1.6s infinite; }
.rg .over { color: #29a1ff; } .rg .lost { color: #f5a623; } .rg .bad { color: #ff6b6b; }
@keyframes rgp { 50% { opacity: 0.25; } }
.rg .track { height: 7px; border-radius: 4px; background: #2a2f36; overflow: hidden; display: flex; }
.rg .track i { display: block; height: 100%; }
.rg .tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(84px, 1fr)); gap: 6px; margin: 8px 0 2px; }
.rg .tiles div { background: #22262c; border-radius: 8px; padding: 5px 8px; color: #94a0ad; font-size: 11px; }
.rg .tiles b { display: block; color: #fff; font-size: 17px; line-height: 1.2; font-variant-numeric: tabular-nums; }
.rg h4 { margin: 12px 0 4px; font-size: 12px; color: #b9c3ce; font-weight: 600; }
.rg table { width: 100%; border-collapse: collapse; font-size: 12px; font-variant-numeric: tabular-nums; }
.rg th { text-align: left; color: #94a0ad; font-weight: 500; padding: 2px 6px 4px 0; }
.rg td { padding: 4px 6px 4px 0; border-top: 1px solid #2d333b; overflow-wrap: anywhere; }
.rg td.n, .rg th.n { text-align: right; white-space: nowrap; }
.rg .row { display: grid; grid-template-columns: minmax(70px, 32%) 1fr 64px; gap: 8px; align-items: center;
  margin: 3px 0; font-size: 12px; }
.rg .row span:last-child { text-align: right; font-variant-numeric: tabular-nums; }
.rg .note { color: #f5a623; margin: 6px 0; overflow-wrap: anywhere; }
.rg .cams { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 8px; }
.rg figure { margin: 0; } .rg img { display: block; width: 100%; border-radius: 8px; background: #111; }
.rg figcaption { font-size: 11px; color: #94a0ad; margin-top: 2px; }
.rg .wide { display: grid; gap: 12px; }
.rg .side { display: grid; gap: 4px; margin-top: 6px; }
.rg .chart { display: block; width: 100%; height: auto; font-size: 13px; margin-top: 6px; }
.rg .chart text { fill: #aeb8c3; } .rg .grid { stroke: #333a43; stroke-width: 1; }
.rg .chart polyline, .rg .chart circle, .rg .chart rect { filter: brightness(1.45) saturate(0.9); }
.rg .facts { display: grid; grid-template-columns: repeat(3, 1fr); gap: 4px 8px; font-size: 12px; margin-top: 6px; }
.rg .facts span { color: #94a0ad; display: block; font-size: 11px; }
</style>
"""


def html(*parts: str) -> str:
    """Parts of the page in its style."""
    return f'{CSS}<div class="rg">{"".join(parts)}</div>'


def header(name: str, watch: Watch, recorded: int, note: str = "") -> str:
    """Name, state and key figures of a run.

    Args:
        name: Name of the run or its folder.
        watch: Received state of the run.
        recorded: Number of durable episodes in its folder; 0 if the folder is not on this machine.
        note: Further text.
    """
    status = watch.status
    kind, words = _health(watch, recorded)
    head = (
        f'<div class="head"><span class="name">{escape(name)}</span>'
        f'<span class="badge {kind}"><i></i>{escape(words)}</span></div>'
    )
    if status is None:
        return html(head, _tiles([(f"{recorded:,}", "episodes")]) if recorded else _why(watch), _soft(note))
    share = 100 * status.committed / max(status.wanted, 1)
    rate = watch.samples_hz
    tiles = [
        (f"{status.committed:,}", f"of {status.wanted:,} episodes"),
        (f"{status.samples:,}", "samples"),
        ("-" if math.isnan(rate) else f"{rate:,.0f}", "samples/s"),
        (f"{sum(status.rejected.values()):,}", "rejected"),
    ]
    bar = f'<div class="track"><i style="width:{share:.1f}%;background:#29a1ff"></i></div>'
    trouble = "".join(f'<p class="note">{escape(text)}</p>' for text in (status.trouble, status.failed) if text)
    return html(head, bar, _tiles(tiles), trouble, _why(watch) if kind == "lost" else "", _soft(note))


def _health(watch: Watch, recorded: int) -> tuple[str, str]:
    status = watch.status
    if status and status.failed:
        return "bad", "ended"
    if status and status.finished:
        return "over", "complete"
    if watch.connection:
        return ("lost", "waiting for the fleet") if status or not recorded else ("over", "recorded")
    return "live", "live"


def _why(watch: Watch) -> str:
    return _soft(watch.connection)


def _soft(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>' if text else ""


def _tiles(tiles: Iterable[tuple[str, str]]) -> str:
    return f'<div class="tiles">{"".join(f"<div><b>{a}</b>{b}</div>" for a, b in tiles)}</div>'


def moment(state: LiveState, track: Track | None, worker: str = "") -> str:
    """State of an episode at one time."""
    seconds = state.time_ns / 1e9
    outcome = track.outcome if track else None
    ended = (
        f'<span class="badge" style="color:{OUTCOME_COLOURS[outcome]}"><i></i>'
        f"{escape(outcome.value.replace('_', ' '))}</span>"
        if outcome
        else '<span class="badge live"><i></i>under way</span>'
    )
    near = state.human_distance_m
    facts = [
        ("time", f"{seconds:.1f} s"),
        ("speed", f"{state.v_mps:.2f} m/s"),
        ("turn", f"{state.w_radps:+.2f} rad/s"),
        ("goal", f"{math.dist(state.goal_xy_m, state.robot_xyzyaw[:2]):.1f} m"),
        ("nearest human", f"{near:.1f} m" if math.isfinite(near) else "none"),
        ("collision in", time_text(state.time_to_collision_s)),
    ]
    cells = "".join(f"<div><span>{name}</span>{value}</div>" for name, value in facts)
    who = state.driver.value + (f" on {worker}" if worker else "")
    title = f'<b>{escape(state.episode.episode_id)}</b><span class="soft">{escape(who)}</span>{ended}'
    return html(f'<div class="head">{title}</div><div class="facts">{cells}</div>')


def pictures(images: Pictures, kind: str, robot: RobotConfig) -> str:
    """Images of all cameras at one time, over the whole width."""
    return html(_rows(images, kind, robot)) if images else ""


def cameras(workers: Iterable[Seen], robot: RobotConfig) -> str:
    """The newest images of all workers that render."""
    shown = [
        f'<div>{_rows(pictures_of(seen.preview), seen.preview.format, robot)}<p class="soft">'
        f"{escape(f'{seen.name} · {seen.preview.episode.episode_id} · {seen.preview.time_ns / 1e9:.1f} s')}</p></div>"
        for seen in workers
        if seen.preview is not None
    ]
    empty = '<p class="soft">Images appear as soon as an episode is rendered.</p>'
    # Several cameras of one robot side by side need the width.
    grid = "cams" if not robot.cameras else "wide"
    return html(f'<div class="{grid}">{"".join(shown)}</div>' if shown else empty)


def _rows(images: Pictures, kind: str, robot: RobotConfig) -> str:
    """Images of one time: cameras from left to right, depths below; names where there are several."""
    rows = shown_images(images, robot)
    found = []
    for row in rows:
        figures = "".join(
            _figure(images[name], kind, name, caption_of(name, robot) if len(images) > 1 else "") for name in row
        )
        found.append(f'<div class="side" style="grid-template-columns: repeat({len(row)}, 1fr)">{figures}</div>')
    return "".join(found)


def _figure(image: bytes, kind: str, name: str, caption: str) -> str:
    if kind_of(name) != RGB:
        image, kind = _shaded(name, image), "jpeg"
    kind = kind if kind in ("jpeg", "png") else "jpeg"
    source = f"data:image/{kind};base64,{base64.b64encode(image).decode()}"
    words = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f'<figure><img src="{source}" alt="camera">{words}</figure>'


@functools.lru_cache(maxsize=64)
def _shaded(name: str, image: bytes) -> bytes:
    """Depths as a shaded image for browsers; empty if they cannot be decoded."""
    pixels = decode_output(kind_of(name), image)
    return b"" if pixels is None else jpeg_bytes(shaded(pixels))


def stages(status: StatusReply | None, spec: RunSpec | None) -> str:
    """Bars of the episodes that wait or are processed, by stage, and the reasons of rejections."""
    if status is None:
        return ""
    names = [stage.name for stage in spec.stages] if spec else list({**status.waiting, **status.leased})
    most = max([1, *(status.waiting.get(name, 0) + status.leased.get(name, 0) for name in names)])
    rows = [
        _bar(
            name,
            [(status.leased.get(name, 0) / most, BAR_COLOURS[0]), (status.waiting.get(name, 0) / most, "#4a5766")],
            f"{status.leased.get(name, 0)} + {status.waiting.get(name, 0)}",
        )
        for name in names
    ]
    parts = ["<h4>Episodes at each stage: at work + waiting</h4>", *rows]
    tried = status.committed + sum(status.rejected.values())
    if status.rejected:
        parts.append(f"<h4>Rejected, of {tried:,} tried</h4>")
        parts += _counts(status.rejected, "#ff6b6b")
    if status.kept:
        parts += ["<h4>Kept although they failed</h4>", *_counts(status.kept, "#f5a623")]
    if sum(status.cpu_s.values()):
        total = sum(status.cpu_s.values())
        shares = [
            (seconds / total, BAR_COLOURS[k % len(BAR_COLOURS)]) for k, seconds in enumerate(status.cpu_s.values())
        ]
        words = ", ".join(f"{escape(name)} {100 * seconds / total:.0f} %" for name, seconds in status.cpu_s.items())
        parts += [f"<h4>Processor time</h4>{_track(shares)}", f'<p class="soft">{words}</p>']
    if status.requeued:
        parts.append(f'<p class="soft">{status.requeued} leases ended without a result</p>')
    return "".join(parts)


def _counts(counts: Mapping[str, int], colour: str) -> list[str]:
    most = max(counts.values())
    ordered = sorted(counts.items(), key=lambda entry: -entry[1])
    return [_bar(name.replace("_", " "), [(count / most, colour)], f"{count:,}") for name, count in ordered[:8]]


def _bar(name: str, shares: Sequence[tuple[float, str]], value: str) -> str:
    return f'<div class="row"><span>{escape(name)}</span>{_track(shares)}<span>{value}</span></div>'


def _track(shares: Sequence[tuple[float, str]]) -> str:
    parts = "".join(f'<i style="width:{100 * share:.1f}%;background:{colour}"></i>' for share, colour in shares)
    return f'<div class="track">{parts}</div>'


def charts(watch: Watch) -> str:
    """Samples/s, and the queue, over time."""
    seconds, rates = watch.progress.rates(0, RATE_WINDOW_S)
    unit, scale = ("min", 60.0) if len(seconds) and seconds[-1] > 180 else ("s", 1.0)
    x = (seconds - seconds[0]) / scale if len(seconds) else seconds
    queue = [
        Curve(name=name, x=x, y=watch.progress.curve(column)[1]) for column, name in ((3, "leases"), (2, "waiting"))
    ]
    return "".join(
        (
            line_chart([Curve(name="samples/s", x=x, y=rates)], x_name=unit, what="Recorded samples/s", y_max=1.0),
            line_chart(queue, x_name=unit, what="Queue and leases", y_max=1.0),
        )
    )


def learning(
    losses: Sequence[Curve], success: Sequence[Curve], *, losses_over: str = "samples", success_over: str = "min"
) -> str:
    """Charts of a policy's losses and success rates."""
    drawn = (
        line_chart(losses, x_name=losses_over, what="Loss"),
        line_chart(success, x_name=success_over, what="Success rate", y_max=1.0),
    )
    return "".join(drawn)


def evaluations(watch: Watch) -> str:
    """Success rates of the received evaluations, the newest policy first."""
    rates: dict[tuple[str, str, str], list[bool]] = {}
    for record in watch.evaluations:
        rates.setdefault((record.policy, record.method, record.task), []).append(record.outcome is Outcome.SUCCESS)
    rows = [
        _bar(
            f"{method} {policy[:8]} {task}",
            [(float(np.mean(results)), BAR_COLOURS[2])],
            f"{100 * float(np.mean(results)):.0f} % of {len(results)}",
        )
        for (policy, method, task), results in reversed(rates.items())
    ]
    return "".join(["<h4>Evaluations: success rate</h4>", *rows[:8]]) if rows else ""


def workers(watch: Watch) -> str:
    """Table of the workers with their current work and load."""
    now_s = watch.clock()
    rows = [_worker(seen, now_s) for seen in sorted(watch.workers.values(), key=lambda seen: (seen.role, seen.name))]
    if not rows:
        return html('<p class="soft">No worker is active.</p>')
    numbers = "".join(f'<th class="n">{name}</th>' for name in ("done", "CPU", "MB"))
    head = f"<tr><th></th><th>worker</th><th>does</th>{numbers}</tr>"
    troubles = [
        f'<p class="note">{escape(seen.name)}: {escape(seen.trouble)}</p>'
        for seen in watch.workers.values()
        if seen.trouble
    ]
    return html(f"<table>{head}{''.join(rows)}</table>", *troubles)


def _worker(seen: Seen, now_s: float) -> str:
    does = "gone"
    if seen.alive:
        index = f" #{seen.episode.index}" if seen.episode else ""
        does = f"{seen.stage}{index}, {now_s - seen.since_s:.0f} s" if seen.stage else "-"
    kind = "bad" if not seen.alive else "lost" if seen.trouble else "live" if seen.stage else "over"
    cpu = f"{number_text(seen.cpu_s)} s" if seen.cpu_s else ""
    memory = f"{seen.memory_bytes / 1e6:,.0f}" if seen.memory_bytes else ""
    cells = f"<td>{escape(seen.name)}</td><td>{escape(does)}</td>"
    numbers = "".join(f'<td class="n">{text}</td>' for text in (str(seen.done or ""), cpu, memory))
    return f'<tr><td><span class="{kind}">●</span></td>{cells}{numbers}</tr>'
