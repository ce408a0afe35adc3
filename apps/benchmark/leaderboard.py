"""The table of drivers: rows of several folders of one suite, as a page and as Markdown."""

import dataclasses
import itertools
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from readygo.apps.evaluation.watch import badness
from readygo.apps.report.markdown import markdown_lines
from readygo.apps.report.page import Block, Estimate, MediaFigure, PageTable, Subheading, page, small_print
from readygo.apps.report.tables import measure_cell, measure_title
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import (
    BenchmarkedDriver,
    check_suite,
    check_unchanged,
    join_origins,
    read_cells,
    read_manifest,
)
from readygo.runs.benchmark.inputs import DriverInputs, row_of
from readygo.runs.benchmark.suite import OpenSuite
from readygo.services.evaluator import (
    EXPERT,
    MEASURES,
    Comparison,
    EpisodeRecord,
    Measure,
    Score,
    compare_all,
    scores_of,
    short_name,
)

SHOWN = (
    *("total", "success", "spl", "compliance", "art_s", "human_collision", "static_collision"),
    *("intrusion", "collision_time_min_s", "jerk_mps3"),
)
"""Measures of the tables, in their order."""
_SUCCESS = next(measure for measure in MEASURES if measure.name == "success")
_NOTE = (
    "SR: share of the episodes in which the robot comes within {radius_m:g} m of the goal, without collision, in "
    "{limit_s:g} s. SPL: success weighted by path length. PSC: share of the time with 1.0 m or more between the "
    "centres of robot and nearest human. Total: 0.4 SR + 0.3 SPL + 0.3 PSC. ART: mean reaching time, a failure "
    "counts the time limit. Personal space: share of the time within 0.5 m of a side. Least time to collision: if "
    "robot and human kept their velocities, at most 10 s. In brackets: 95 % intervals, Wilson's of rates of one "
    "policy, else of 2,000 resamples of the episodes; they say nothing about other seeds of a training."
)
_INPUTS_NOTE = (
    "All are given the goal. Map: it knows the scene's map and its place on it. People: which people it is told of. "
    "Scenes seen: scenes of the suite among the data of its training. Training seeds: different policies of a row. "
    "Rows that were made with different versions name theirs; records of two numeric classes may differ in last digits."
)
INPUT_TITLES = ("Map", "People", "Images", "Trained on", "Scenes seen")
_NOT_STATED = "not stated"
_MADE_WITH = (("readygo", "readygo"), ("commit", "Commit"), ("numeric_class", "Numeric class"))
"""What rows are made with, and its titles: columns where rows differ in it."""
_HASH = re.compile(r"\b[0-9a-f]{40}\b")
_COMPARISON_NOTE = (
    "The same episodes for both: p of McNemar's exact test of the successes, differences with paired bootstrap "
    "intervals of 95 %. No correction for many comparisons."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class LeaderboardRow:
    """One row: a driver, or policies of several training seeds."""

    name: str
    driver: BenchmarkedDriver
    """The first of its drivers."""
    seeds: int
    """Different policies behind the row; 0 for drivers that learn nothing, or that do not say whether they do."""
    made_by: Mapping[str, str]
    """Versions, commits and numeric classes that its records were made with."""
    cells: Mapping[str, Sequence[EpisodeRecord]]
    """Records by cell, under the names of their drivers."""

    @property
    def episodes(self) -> int:
        """Fewest episodes of a cell and driver."""
        return min(min(Counter(record.method for record in records).values()) for records in self.cells.values())


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaderboard:
    """All rows of a suite."""

    suite: OpenSuite
    rows: Sequence[LeaderboardRow]
    reference: str
    """Driver that all others are compared with."""
    folders: Mapping[str, Path]
    """Folder of each driver's records."""

    @property
    def episodes(self) -> int:
        """Fewest episodes of a cell and row."""
        return min(row.episodes for row in self.rows)

    def scores(self, cell: str) -> dict[str, Mapping[str, Score]]:
        """Measures of a cell, by row."""
        records = [dataclasses.replace(record, method=row.name) for row in self.rows for record in row.cells[cell]]
        limit_s = self.suite.config(cell).episode.time_limit_s
        return {row: scores for (_, row), scores in scores_of(records, time_limit_s=limit_s).items()}

    def comparisons(self, cell: str) -> list[Comparison]:
        """Every driver beside the reference, policies of several seeds one by one."""
        records = [record for row in self.rows for record in row.cells[cell]]
        return compare_all(records, self.reference, time_limit_s=self.suite.config(cell).episode.time_limit_s)


def read_leaderboard(folders: Sequence[Path], suite: OpenSuite, reference: str = "") -> Leaderboard:
    """Join folders of results.

    Args:
        folders: One or more folders; a driver that several have counts once.
        suite: Suite that all of them are of.
        reference: Driver that the others are compared with; by default the expert, else the first one.

    Returns:
        The leaderboard, its rows by their total in the paper's cell.

    Raises:
        RunError: If a folder is of another suite, was changed, or lacks records, two have different drivers of one
            name, or there is no reference.
    """
    drivers: dict[str, BenchmarkedDriver] = {}
    made_by: dict[str, Mapping[str, str]] = {}
    places: dict[str, Path] = {}
    cells: dict[str, list[EpisodeRecord]] = {cell: [] for cell in suite.suite.cells}
    for folder in folders:
        manifest = read_manifest(folder)
        check_suite(manifest, suite, folder)
        check_unchanged(folder, suite, manifest)
        for name, driver in manifest.drivers.items():
            if drivers.get(name, driver).sha256 != driver.sha256:
                raise RunError(
                    f"{folder} has another driver {name} than a folder before it: give one of them another name."
                )
        new = manifest.drivers.keys() - drivers.keys()
        places |= dict.fromkeys(new, folder)
        made_by |= dict.fromkeys(new, manifest.made_by)
        for cell, records in read_cells(folder, suite, new).items():
            cells[cell] += records
        drivers |= {name: manifest.drivers[name] for name in manifest.drivers if name in new}
    for cell, records in cells.items():
        if missing := drivers.keys() - {record.method for record in records}:
            name = min(missing)
            raise RunError(f"{places[name]} has no records of {name} in the cell {cell}: let the run end into it.")
    reference = reference or (EXPERT if EXPERT in drivers else next(iter(drivers)))
    if reference not in drivers:
        raise RunError(f"There is no driver {reference!r} to compare with; there are {', '.join(drivers)}.")
    board = Leaderboard(
        suite=suite,
        rows=_rows(drivers, made_by, cells),
        reference=reference,
        folders=places,
    )
    totals = {row: scores["total"].mean for row, scores in board.scores(suite.suite.paper_cell).items()}
    return dataclasses.replace(board, rows=sorted(board.rows, key=lambda row: -totals[row.name]))


def _rows(
    drivers: Mapping[str, BenchmarkedDriver],
    made_by: Mapping[str, Mapping[str, str]],
    cells: Mapping[str, Sequence[EpisodeRecord]],
) -> list[LeaderboardRow]:
    groups: dict[str, list[str]] = {}
    for name in drivers:
        groups.setdefault(row_of(name), []).append(name)
    return [
        LeaderboardRow(
            name=row,
            driver=drivers[names[0]],
            seeds=len({drivers[name].sha256 for name in names}) if drivers[names[0]].inputs.learns else 0,
            made_by=join_origins(made_by[name] for name in names),
            cells={cell: [record for record in records if record.method in names] for cell, records in cells.items()},
        )
        for row, names in groups.items()
    ]


def leaderboard_tables(board: Leaderboard) -> dict[str, list[Block]]:
    """The tables of a leaderboard, by heading."""
    cells = board.suite.suite.cells
    scores = {cell: board.scores(cell) for cell in cells}
    paper = board.suite.suite.paper_cell
    episode = board.suite.config(paper).episode
    note = _NOTE.format(radius_m=episode.success_radius_m, limit_s=episode.time_limit_s)
    return {
        "Drivers": [_driver_table(board), small_print(_INPUTS_NOTE)],
        "Success by cell": [
            PageTable(
                ("Cell", *(short_name(row.name) for row in board.rows)),
                [[cell, *(_success(scores[cell].get(row.name, {})) for row in board.rows)] for cell in cells],
            ),
            small_print(" ".join(f"{name}: {cell.words}." for name, cell in cells.items())),
        ],
        f"All measures in {paper}": [_measure_table(board.rows, scores[paper]), small_print(note)],
        "All measures elsewhere": list(
            itertools.chain.from_iterable(
                (Subheading(cell), _measure_table(board.rows, scores[cell])) for cell in cells if cell != paper
            )
        ),
        f"Beside {short_name(board.reference)}": [_comparison_table(board), small_print(_COMPARISON_NOTE)],
    }


def leaderboard_html(board: Leaderboard, films: Sequence[MediaFigure] = ()) -> str:
    """The page of a leaderboard.

    Args:
        board: Its rows.
        films: Videos of the median and the worst episodes.
    """
    suite = board.suite.suite
    best = board.rows[0].name
    total = board.scores(suite.paper_cell)[best]["total"].mean
    return page(
        f"Leaderboard of {suite.name}",
        f"{len(board.rows)} drivers in the same {board.episodes} episodes of each of {len(suite.cells)} cells. Figures "
        f"of the ReaDy-Go paper are comparable with those of the cell {suite.paper_cell} alone.",
        tiles=[
            (str(len(board.rows)), "drivers"),
            (str(board.episodes), "episodes per cell"),
            (f"{total:.2f}", f"best total, {short_name(best)}"),
        ],
        sections={**leaderboard_tables(board), "Median and worst episodes": list(films)},
        facts={"suite": f"{suite.name} {board.suite.sha256[:12]}", **_facts(board)},
    )


def leaderboard_markdown(board: Leaderboard) -> str:
    """The tables of a leaderboard in Markdown."""
    suite = board.suite.suite
    facts = "; ".join([f"Suite {board.suite.sha256}", *(f"{name} {value}" for name, value in _facts(board).items())])
    lines = [f"# Leaderboard of {suite.name}", "", f"{facts}; {board.episodes} episodes per cell."]
    for heading, blocks in leaderboard_tables(board).items():
        lines += ["", f"## {heading}"]
        for block in blocks:
            lines += ["", *markdown_lines(block)]
    return "\n".join([*lines, ""])


def _facts(board: Leaderboard) -> dict[str, str]:
    """All versions, commits and numeric classes that its records were made with."""
    return {name: _short_hashes(value) for name, value in join_origins(row.made_by for row in board.rows).items()}


def films_to_show(board: Leaderboard) -> list[tuple[LeaderboardRow, str, EpisodeRecord]]:
    """The median and the worst episode of each row in the paper's cell, with a word for which it is."""
    chosen = []
    for row in board.rows:
        ranked = sorted(row.cells[board.suite.suite.paper_cell], key=badness)
        chosen += [(row, "median", ranked[len(ranked) // 2]), (row, "worst", ranked[0])] if ranked else []
    return chosen


def _driver_table(board: Leaderboard) -> PageTable:
    columns = ("Driver", *INPUT_TITLES, "Training seeds", "Episodes per cell")
    differing = [(name, title) for name, title in _MADE_WITH if len({row.made_by.get(name) for row in board.rows}) > 1]
    cells = [
        [
            short_name(row.name),
            *input_cells(row.driver.inputs),
            str(row.seeds or ""),
            str(row.episodes) + ("" if row.episodes == board.suite.suite.episodes else ", incomplete"),
            *(_short_hashes(row.made_by.get(name, "")) for name, _ in differing),
        ]
        for row in board.rows
    ]
    return PageTable((*columns, *(title for _, title in differing)), cells, text_columns=1 + len(INPUT_TITLES))


def input_cells(inputs: DriverInputs) -> list[str]:
    """What a driver is given and has learned from, as `INPUT_TITLES` has the columns."""
    return [
        "yes" if inputs.map else "no",
        inputs.people or "no",
        ", ".join(inputs.images) or "no",
        _stated(inputs.trained_on, "nothing"),
        _stated(inputs.seen, "none"),
    ]


def _stated(value: str | Sequence[str] | None, empty: str) -> str:
    """What a driver states, in words."""
    if value is None:
        return _NOT_STATED
    return (value if isinstance(value, str) else ", ".join(value)) or empty


def _short_hashes(text: str) -> str:
    return _HASH.sub(lambda match: match[0][:12], text)


def _measure_table(rows: Iterable[LeaderboardRow], scores: Mapping[str, Mapping[str, Score]]) -> PageTable:
    measures = [measure for name in SHOWN for measure in MEASURES if measure.name == name]
    cells = [
        [
            short_name(row.name),
            *(measure_cell(measure, scores.get(row.name, {}).get(measure.name)) for measure in measures),
        ]
        for row in rows
    ]
    return PageTable(("Driver", *map(measure_title, measures)), cells)


def _comparison_table(board: Leaderboard) -> PageTable:
    compared = ("success", "total", "compliance")
    measures = [measure for name in compared for measure in MEASURES if measure.name == name]
    cells: list[list[str | Block]] = []
    for cell in board.suite.suite.cells:
        for pair in board.comparisons(cell):
            won = f"+{pair.only_method} -{pair.only_reference}"
            differences = [_signed(measure, pair.differences.get(measure.name)) for measure in measures]
            cells.append([cell, short_name(pair.method), won, f"{pair.mcnemar_p:.2g}", *differences])
    columns = ("Cell", "Driver", "Only one reaches", "p", *(f"Difference of {m.title}" for m in measures))
    return PageTable(columns, cells, text_columns=2)


def _success(scores: Mapping[str, Score]) -> str | Block:
    return measure_cell(_SUCCESS, scores.get(_SUCCESS.name))


def _signed(measure: Measure, score: Score | None) -> str | Block:
    if score is None:
        return ""
    scale, digits = (100, 0) if measure.unit.startswith("%") else (1, 2)
    mean, low, high = (f"{scale * value:+.{digits}f}" for value in (score.mean, score.low, score.high))
    return Estimate(mean, f"{low} to {high}")
