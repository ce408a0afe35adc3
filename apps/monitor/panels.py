"""The HTML panels beside the scene. Names, reasons and errors come from other processes: templates escape all text."""

import base64
import functools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from readygo.apps.monitor.track import EpisodeTrack, Pictures, pictures_of, time_text
from readygo.apps.monitor.watch import RATE_WINDOW_S, RunWatch, Seen
from readygo.apps.pictures.episode_film import enlarge
from readygo.apps.pictures.perceived import draw_on_image
from readygo.apps.pictures.shades import shade_depth
from readygo.apps.pictures.side_by_side import caption_of, shown_images
from readygo.apps.report.page import draw
from readygo.common.drawing.charts import Curve, line_chart, number_text
from readygo.common.drawing.files import jpeg_bytes
from readygo.common.images.encoded import decode_image
from readygo.common.images.files import decode_output
from readygo.common.images.names import RGB, kind_of
from readygo.common.messages import Outcome, RunSpec, StatusReply
from readygo.common.messages.live import LivePerception, LiveState
from readygo.common.robot import RobotConfig

BAR_COLOURS = ("#29a1ff", "#ffae34", "#78dc78", "#d678ff", "#ff6b6b", "#8fa3b8")
OUTCOME_COLOURS = {
    Outcome.SUCCESS: "#2fb67c",
    Outcome.STATIC_COLLISION: "#e5484d",
    Outcome.HUMAN_COLLISION: "#e5484d",
    Outcome.TIMEOUT: "#f5a623",
}
MARKED_HEIGHT_PX = 288
"""Approximate height of images with marks [px]: they are enlarged by an integer factor."""
ROWS_MAX = 8
"""Largest number of bars below one heading."""
Segments = Sequence[tuple[float, str]]
"""Parts of a bar: share in 0..1 and colour."""


def html(*parts: str) -> str:
    """Parts of the page in its style."""
    return _draw_panel("panel", parts)


def sentence(text: str) -> str:
    """A panel that says one sentence."""
    return html(_draw_panel("soft", text))


def _draw_panel(macro: str, *data: Any) -> str:
    return draw("panels.html", macro, *data)


def header(name: str, watch: RunWatch, recorded: int, note: str = "") -> str:
    """Name, state and key figures of a run.

    Args:
        name: Name of the run or its folder.
        watch: Received state of the run.
        recorded: Number of durable episodes in its folder; 0 if the folder is not on this machine.
        note: Further text.
    """
    status = watch.status
    kind, words = _health(watch, recorded)
    if status is None:
        tiles = [(f"{recorded:,}", "episodes")] if recorded else []
        return html(
            _draw_panel("header", name, kind, words, tiles, [], [], ["" if recorded else watch.connection, note])
        )
    rate = watch.samples_hz
    tiles = [
        (f"{status.committed:,}", f"of {status.wanted:,} episodes"),
        (f"{status.samples:,}", "samples"),
        ("-" if math.isnan(rate) else f"{rate:,.0f}", "samples/s"),
        (f"{sum(status.rejected.values()):,}", "rejected"),
    ]
    progress = [(status.committed / max(status.wanted, 1), BAR_COLOURS[0])]
    troubles = [text for text in (status.trouble, status.failed) if text]
    notes = [watch.connection if kind == "lost" else "", note]
    return html(_draw_panel("header", name, kind, words, tiles, progress, troubles, notes))


def _health(watch: RunWatch, recorded: int) -> tuple[str, str]:
    status = watch.status
    if status and status.failed:
        return "bad", "ended"
    if status and status.finished:
        return "over", "complete"
    if watch.connection:
        return ("lost", "waiting for the fleet") if status or not recorded else ("over", "recorded")
    return "live", "live"


def moment(state: LiveState, track: EpisodeTrack | None, worker: str = "") -> str:
    """State of an episode at one time."""
    outcome = track.outcome if track else None
    near_m = state.human_distance_m
    facts = {
        "time": f"{state.time_ns / 1e9:.1f} s",
        "speed": f"{state.v_mps:.2f} m/s",
        "turn": f"{state.w_radps:+.2f} rad/s",
        "goal": f"{math.dist(state.goal_xy_m, state.robot_xyzyaw[:2]):.1f} m",
        "nearest human": f"{near_m:.1f} m" if math.isfinite(near_m) else "none",
        "collision in": time_text(state.time_to_collision_s),
    }
    driver = state.driver.value + (f" on {worker}" if worker else "")
    ended = (outcome.value.replace("_", " "), OUTCOME_COLOURS[outcome]) if outcome else ("", "")
    return html(_draw_panel("moment", state.episode.episode_id, driver, *ended, facts))


def pictures(images: Pictures, kind: str, robot: RobotConfig) -> str:
    """Images of all cameras at one time, over the whole width."""
    return html(_draw_panel("images", _image_rows(images, kind, robot))) if images else ""


def mark_people(images: Pictures, perception: LivePerception, robot: RobotConfig) -> Pictures:
    """Images of one time, the first camera's with what was perceived in it; unchanged if it cannot be decoded."""
    pixels = decode_image(images[RGB])
    if pixels is None:
        return images
    picture = enlarge(pixels, MARKED_HEIGHT_PX)
    draw_on_image(picture, perception, robot.camera)
    return {**images, RGB: jpeg_bytes(picture)}


def cameras(workers: Iterable[Seen], robot: RobotConfig) -> str:
    """The newest images of all workers that render."""
    previews = [
        (
            _image_rows(pictures_of(seen.preview), seen.preview.format, robot),
            f"{seen.name} · {seen.preview.episode.episode_id} · {seen.preview.time_ns / 1e9:.1f} s",
        )
        for seen in workers
        if seen.preview is not None
    ]
    if not previews:
        return sentence("Images appear as soon as an episode is rendered.")
    # Several cameras of one robot side by side need the width.
    return html(_draw_panel("cameras", "wide" if robot.cameras else "cams", previews))


def _image_rows(images: Pictures, kind: str, robot: RobotConfig) -> list[list[tuple[str, str]]]:
    """Sources and captions of images of one time: cameras from left to right, depths below."""
    several = len(images) > 1
    return [
        [(_source(images[name], kind, name), caption_of(name, robot) if several else "") for name in row]
        for row in shown_images(images, robot)
    ]


def _source(image: bytes, kind: str, name: str) -> str:
    if kind_of(name) != RGB:
        image, kind = _shade_depth(name, image), "jpeg"
    kind = kind if kind in ("jpeg", "png") else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(image).decode()}"


@functools.lru_cache(maxsize=64)
def _shade_depth(name: str, image: bytes) -> bytes:
    """Depths as a shaded image for browsers; empty if they cannot be decoded."""
    pixels = decode_output(kind_of(name), image)
    return b"" if pixels is None else jpeg_bytes(shade_depth(pixels))


def stages(status: StatusReply | None, spec: RunSpec | None) -> str:
    """Bars of the episodes that wait or are processed, by stage, and the reasons of rejections."""
    if status is None:
        return ""
    names = [stage.name for stage in spec.stages] if spec else list({**status.waiting, **status.leased})
    counts = {name: (status.leased.get(name, 0), status.waiting.get(name, 0)) for name in names}
    most = max([1, *(leased + waiting for leased, waiting in counts.values())])
    rows = [
        (name, [(leased / most, BAR_COLOURS[0]), (waiting / most, "#4a5766")], f"{leased} + {waiting}")
        for name, (leased, waiting) in counts.items()
    ]
    parts = [_draw_panel("bars", "Episodes at each stage: at work + waiting", rows)]
    if status.rejected:
        tried = status.committed + sum(status.rejected.values())
        parts.append(_draw_panel("bars", f"Rejected, of {tried:,} tried", _count_bars(status.rejected, "#ff6b6b")))
    if status.kept:
        parts.append(_draw_panel("bars", "Kept although they failed", _count_bars(status.kept, "#f5a623")))
    if total := sum(status.cpu_s.values()):
        shares = {name: seconds / total for name, seconds in status.cpu_s.items()}
        segments = [(share, BAR_COLOURS[k % len(BAR_COLOURS)]) for k, share in enumerate(shares.values())]
        words = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
        parts.append(_draw_panel("processor_time", segments, words))
    if status.requeued:
        parts.append(_draw_panel("soft", f"{status.requeued} leases ended without a result"))
    return "".join(parts)


def _count_bars(counts: Mapping[str, int], colour: str) -> list[tuple[str, Segments, str]]:
    most = max(counts.values())
    ordered = sorted(counts.items(), key=lambda entry: -entry[1])
    return [(name.replace("_", " "), [(count / most, colour)], f"{count:,}") for name, count in ordered[:ROWS_MAX]]


def charts(watch: RunWatch) -> str:
    """Samples/s, and the queue, over time."""
    seconds, rates = watch.progress.rates(0, RATE_WINDOW_S)
    unit, scale = ("min", 60.0) if len(seconds) and seconds[-1] > 180 else ("s", 1.0)
    x = (seconds - seconds[0]) / scale if len(seconds) else seconds
    queue = [
        Curve(name=name, x=x, y=watch.progress.curve(column)[1]) for column, name in ((3, "leases"), (2, "waiting"))
    ]
    rate = Curve(name="samples/s", x=x, y=rates)
    return line_chart([rate], x_name=unit, what="Recorded samples/s", y_max=1.0) + line_chart(
        queue, x_name=unit, what="Queue and leases", y_max=1.0
    )


def learning(losses: Sequence[Curve], success: Sequence[Curve]) -> str:
    """Charts of a policy's losses over samples, and of its success rates over minutes."""
    return line_chart(losses, x_name="samples") + line_chart(success, x_name="min", what="Success rate", y_max=1.0)


def evaluations(watch: RunWatch) -> str:
    """Success rates of the received evaluations, the newest policy first."""
    results: dict[tuple[str, str, str], list[bool]] = {}
    for record in watch.evaluations:
        results.setdefault((record.policy, record.method, record.task), []).append(record.outcome is Outcome.SUCCESS)
    rates = {key: (float(np.mean(found)), len(found)) for key, found in reversed(results.items())}
    rows = [
        (f"{method} {policy[:8]} {task}", [(rate, BAR_COLOURS[2])], f"{100 * rate:.0f} % of {count}")
        for (policy, method, task), (rate, count) in rates.items()
    ]
    return _draw_panel("bars", "Evaluations: success rate", rows[:ROWS_MAX]) if rows else ""


def workers(watch: RunWatch) -> str:
    """Table of the workers with their current work and load."""
    if not watch.workers:
        return sentence("No worker is active.")
    now_s = watch.clock()
    rows = [_worker(seen, now_s) for seen in sorted(watch.workers.values(), key=lambda seen: (seen.role, seen.name))]
    troubles = [f"{seen.name}: {seen.trouble}" for seen in watch.workers.values() if seen.trouble]
    return html(_draw_panel("workers", rows, troubles))


def _worker(seen: Seen, now_s: float) -> tuple[str, ...]:
    does = "gone"
    if seen.alive:
        index = f" #{seen.episode.index}" if seen.episode else ""
        does = f"{seen.stage}{index}, {now_s - seen.since_s:.0f} s" if seen.stage else "-"
    kind = "bad" if not seen.alive else "lost" if seen.trouble else "live" if seen.stage else "over"
    cpu = f"{number_text(seen.cpu_s)} s" if seen.cpu_s else ""
    memory = f"{seen.memory_bytes / 1e6:,.0f}" if seen.memory_bytes else ""
    return kind, seen.name, does, str(seen.done or ""), cpu, memory
