"""Joins the records of a sweep by their hashes: sweep.json, and a table of means over the seeds with intervals."""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.apps.report.markdown import markdown_lines
from readygo.apps.report.page import Block, Estimate, PageTable, page, small_print
from readygo.apps.report.tables import measure_cell, measure_title
from readygo.apps.sweep.folder import JOINED_FILE, PointRecord, SweepFolder
from readygo.apps.sweep.plan import Sweep, SweepPoint
from readygo.common.config import section_to_mapping
from readygo.common.documents import write_json
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.runs.benchmark.inputs import row_of
from readygo.services.evaluator import MEASURES, Score, short_name

FORMAT = "readygo-sweep/1"
MARKDOWN_FILE, PAGE_FILE = "sweep.md", "sweep.html"
JOIN_S = 60.0
"""Time to wait for another process that joins the results [s]."""
SHOWN = (
    *("success", "spl", "total", "compliance", "art_s", "human_collision", "static_collision", "intrusion"),
    *("val_static", "val_dynamic", "decisions"),
    *("ratio_v", "ratio_w", "samples_seen", "waypoint_error_m"),
    *("recorded", "learned", "episodes", "samples"),
)
"""Columns of the table, of the measures that the results have; sweep.json has all of them."""
_FRACTIONS = ("spl", "total")
"""Measures in 0..1 that are not shown in percent."""
_LARGE = 1000
_BY_NAME = {measure.name: measure for measure in MEASURES}
_NOTE = (
    "Means over the seeds. In brackets: 95 % intervals of the mean over seeds, by Student's t; a single seed has none, "
    "and equal values of few seeds have one that is too narrow. "
    "sweep.json has every measure of every point."
)
Values = Mapping[str, float]
Part = tuple[str, str]
"""Task or cell, and driver; empty for results without them."""


@dataclass(frozen=True, kw_only=True)
class SweepRow:
    """One row of the table: what an arm reaches in a scene, over its seeds."""

    arm: str
    scene: str
    part: Part
    """Task or cell, and driver; empty for results without them."""
    seeds: int
    scores: Mapping[str, Score]
    """Means over the seeds by measure; `count` is the number of seeds that have it."""


def join_results(folder: SweepFolder, sweep: Sweep) -> list[PointRecord]:
    """Write sweep.json and the tables of the points that are done, and return the records of all that have begun.

    Raises:
        ReadygoError: If a record cannot be read or a file not be written.
    """
    with folder.lock_all(patience_s=JOIN_S) as held:
        if not held:
            raise RunError(f"Another process has joined the results in {folder.path} for {JOIN_S:g} s; end it.")
        pairs = [(point, record) for point in sweep.points if (record := _current(folder, point))]
        rows = sweep_rows([(point, record) for point, record in pairs if record.state == "done"])
        joined = {
            "format": FORMAT,
            "command": sweep.file.command,
            "plan_sha256": sweep.sha256,
            "points": [
                {"arm": point.arm, "scene": point.scene, "seed": point.seed, **section_to_mapping(record)}
                for point, record in pairs
            ],
            "rows": [_row_mapping(row) for row in rows],
        }
        write_json(folder.path / JOINED_FILE, joined, raises=RunError)
        blocks = _blocks(rows)
        title, words = f"Sweep of readygo {sweep.file.command}", _words(sweep, [record for _, record in pairs])
        text = "\n\n".join([f"# {title}", words, *("\n".join(markdown_lines(block)) for block in blocks)])
        write_whole(folder.path / MARKDOWN_FILE, f"{text}\n", raises=RunError)
        html = page(
            title, words, tiles=[], sections={"Means over the seeds": blocks}, facts={"plan": sweep.sha256[:12]}
        )
        write_whole(folder.path / PAGE_FILE, html, raises=RunError)
    return [record for _, record in pairs]


def sweep_rows(pairs: Sequence[tuple[SweepPoint, PointRecord]]) -> list[SweepRow]:
    """The rows of the table, in the order of the plan."""
    groups: dict[tuple[str, str, Part], dict[int, Values]] = {}
    for point, record in pairs:
        for part, values in measured(record.result).items():
            groups.setdefault((point.arm, point.scene, part), {})[point.seed] = values
    return [
        SweepRow(arm=arm, scene=scene, part=part, seeds=len(by_seed), scores=_scores([*by_seed.values()]))
        for (arm, scene, part), by_seed in groups.items()
    ]


def measured(result: Any) -> dict[Part, Values]:
    """The measures of a command's result, by task or cell and driver."""
    if not isinstance(result, Mapping):
        return {}
    for name in ("measures", "scores"):
        if isinstance(scores := result.get(name), Mapping):
            return dict(_of_drivers(scores))
    if isinstance(tests := result.get("test"), Mapping) and tests:
        return dict(_of_tests(tests))
    return {("", ""): dict(_numbers(result))}


def mean_over_seeds(values: Sequence[float], *, share: bool = False) -> Score:
    """Mean of the seeds' values with the 95 % interval of Student's t; NaN as the ends for one seed.

    Args:
        values: One value per seed.
        share: True if values are in 0..1, and so the interval.
    """
    # Imported here: it takes 0.1 s, which most commands do not need.
    from scipy.special import stdtrit

    found = np.array(values, np.float64)
    mean = float(found.mean())
    if len(found) < 2:
        return Score(mean=mean, low=math.nan, high=math.nan, count=1)
    half = float(stdtrit(len(found) - 1, 0.975)) * float(found.std(ddof=1)) / math.sqrt(len(found))
    low, high = (min(max(end, 0.0), 1.0) if share else end for end in (mean - half, mean + half))
    return Score(mean=mean, low=low, high=high, count=len(found))


def _current(folder: SweepFolder, point: SweepPoint) -> PointRecord | None:
    """The record of a point; one that says that it runs, while no process holds it, was interrupted."""
    record = folder.record(point)
    if record is not None and record.state == "running" and not folder.runs(point):
        return dataclasses.replace(record, state="interrupted")
    return record


def _of_drivers(scores: Mapping[str, Any]) -> Iterator[tuple[Part, Values]]:
    """Scores of an evaluation or a benchmark: task or cell -> driver -> measure -> mean.

    Policies that share a row have their mean there.
    """
    for task, drivers in scores.items():
        by_row: dict[str, list[Values]] = {}
        for driver, measures in drivers.items():
            means = {name: score["mean"] for name, score in measures.items() if score["mean"] is not None}
            by_row.setdefault(row_of(driver), []).append(means)
        for row, several in by_row.items():
            names = dict.fromkeys(name for means in several for name in means)
            found = {name: [means[name] for means in several if name in means] for name in names}
            yield (task, row), {name: sum(values) / len(values) for name, values in found.items()}


def _of_tests(tests: Mapping[str, Any]) -> Iterator[tuple[Part, Values]]:
    """Success rates of `learn`: scene -> "task method" -> rate."""
    for scene, rates in tests.items():
        for name, rate in rates.items():
            task, _, method = name.partition(" ")
            yield (f"{task}, {scene}" if len(tests) > 1 else task, method), {"success": rate}


def _numbers(result: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    for name, value in result.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield name, float(value)


def _scores(by_seed: Sequence[Values]) -> dict[str, Score]:
    names = dict.fromkeys(name for values in by_seed for name in values)
    return {
        name: mean_over_seeds(
            [values[name] for values in by_seed if name in values], share=_is_share(name) or name in _FRACTIONS
        )
        for name in names
    }


def _is_share(name: str) -> bool:
    return name in ("val_static", "val_dynamic") or (name in _BY_NAME and _BY_NAME[name].unit.startswith("%"))


def _row_mapping(row: SweepRow) -> dict[str, Any]:
    task, driver = row.part
    scores = {
        name: {end: None if math.isnan(value) else value for end, value in dataclasses.asdict(score).items()}
        for name, score in row.scores.items()
    }
    return {"arm": row.arm, "scene": row.scene, "task": task, "driver": driver, "seeds": row.seeds, "scores": scores}


def _blocks(rows: Sequence[SweepRow]) -> list[Block]:
    """The table; columns of text that no row fills are left out."""
    texts = [
        ("Arm", [row.arm for row in rows]),
        ("Scene", [row.scene for row in rows]),
        ("Task", [row.part[0] for row in rows]),
        ("Driver", [short_name(row.part[1]) for row in rows]),
    ]
    texts = [(title, cells) for title, cells in texts if any(cells)]
    shown = [name for name in SHOWN if any(name in row.scores for row in rows)]
    columns = [*(title for title, _ in texts), "Seeds", *map(_title, shown)]
    cells: list[list[str | Block]] = [
        [*(column[k] for _, column in texts), str(row.seeds), *(_cell(name, row.scores.get(name)) for name in shown)]
        for k, row in enumerate(rows)
    ]
    return [PageTable(columns, cells, text_columns=len(texts)), small_print(_NOTE)] if rows else []


def _title(name: str) -> str:
    if name in _BY_NAME:
        return measure_title(_BY_NAME[name])
    return f"{name} [%]" if _is_share(name) else name


def _cell(name: str, score: Score | None) -> str | Block:
    """A mean with its interval; a single seed has no interval."""
    if score is None:
        return ""
    if name in _BY_NAME:
        cell = measure_cell(_BY_NAME[name], score)
        return dataclasses.replace(cell, interval="") if isinstance(cell, Estimate) and score.count < 2 else cell
    mean, low, high = (_number(name, value) for value in (score.mean, score.low, score.high))
    return Estimate(mean, f"{low} to {high}" if score.count > 1 else "")


def _number(name: str, value: float) -> str:
    if _is_share(name):
        return f"{100 * value:.0f}"
    return f"{value:,.0f}" if abs(value) >= _LARGE else f"{value:.3g}"


def _words(sweep: Sweep, records: Sequence[PointRecord]) -> str:
    """How many points are done, and of which sources they are."""
    done = [record for record in records if record.state == "done"]
    counts = {"arms": sweep.file.arms, "scenes": sweep.file.scenes, "seeds": sweep.file.seeds}
    grid = ", ".join(f"{name} {len(items)}" for name, items in counts.items() if items)
    said = f"{len(done)} of {len(sweep.points)} points are done ({grid})."
    commits = sorted({record.commit[:12] for record in done})
    return f"{said} They are of {len(commits)} commits: {', '.join(commits)}." if len(commits) > 1 else said
