"""Writes docs/tables.md, and the table of README.md: success rates of robots, from the runs that `results/` keeps.

    python -m readygo.benchmarks.tables

The leaderboard joins what `readygo benchmark run` measured in pedestrian-nav/1. Below it are files with the `scores` of
a run that learned, those of `policy/realism.py`, and what an evaluation left as `summary.json`, where they are kept
with `machine` and `command`.
"""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.apps.benchmark.leaderboard import INPUT_TITLES, input_cells
from readygo.common.config import section_from_mapping
from readygo.runs.benchmark.inputs import DriverInputs
from readygo.runs.benchmark.suite import PEDESTRIAN_NAV, open_suite

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE, README = ROOT / "benchmarks" / "results", ROOT / "docs" / "tables.md", ROOT / "README.md"
IN_README = {"the flat": "2026-11-27_flat_again.json", "another flat (seed 3)": "2026-11-27_flat_again_seed3.json"}
"""Results that README.md shows, by what their columns are called there."""
BEGIN, END = "<!-- written by benchmarks.tables -->\n\n", "\n<!-- end -->\n"
INTRODUCTION = """# Tables

Success rates and collisions are percentages of the episodes, with 95 % intervals in brackets. ART is the mean
reaching time in seconds, where a failure counts the time limit. SPL is success weighted by path length. All methods
of a table drove the same episodes: *beside X: +a -b, p* means that a method solves a episodes that X fails, and X
solves b that it fails, with McNemar's p. The task *static* has no pedestrians, *dynamic* has them. `python -m
readygo.benchmarks.tables` writes this page from the files that it names.
"""
COLUMNS = {
    "SR %": ("success", 100.0),
    "ART s": ("art_s", 1.0),
    "SPL": ("spl", 1.0),
    "obstacle collision %": ("static_collision", 100.0),
    "pedestrian collision %": ("human_collision", 100.0),
}
"""Titles, and the measure with the factor for the unit that is shown."""
IN_PAPER_CELL = {
    "Total": ("total", 1.0),
    "SR %": ("success", 100.0),
    "SPL": ("spl", 1.0),
    "PSC %": ("compliance", 100.0),
}
"""Titles and measures of the leaderboard, with the factor for the unit that is shown."""
OF_SCORES = {"static_collision": "static_collision_rate", "human_collision": "human_collision_rate"}
"""What the scores of a run that learned call a measure, where they call it something else."""

Measures = Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]]
"""Task -> method -> measure -> mean, and where it has an interval low and high, and count."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table of the page."""

    title: str
    measures: Measures
    comparisons: Sequence[Mapping[str, Any]] = ()


def tables_of(kept: Mapping[str, Any]) -> list[Table]:
    """The tables of one file of results; none where it holds something else."""
    title = str(kept.get("command", ""))
    if "scores" in kept and "points" in kept:
        return [Table(title=title, measures=_measures_of_scores(kept["scores"]))]
    if "measures" in kept:
        return [Table(title=title, measures=kept["measures"], comparisons=kept.get("comparisons", ()))]
    return [
        Table(title=f"{title or 'realism'} in {scene}", measures=found["measures"], comparisons=found["comparisons"])
        for scene, found in kept.get("scenes", {}).items()
        if "measures" in found
    ]


def page(results: Path) -> str:
    """The whole page.

    Args:
        results: Folder of kept runs.
    """
    found = {path.name: json.loads(path.read_text()) for path in sorted(results.glob("*.json"))}
    kept = {name: each for name, each in found.items() if isinstance(each, dict)}
    lines = [INTRODUCTION, *leaderboard({name: each for name, each in kept.items() if "suite_sha256" in each})]
    for name, each in kept.items():
        for table in tables_of(each):
            lines += [*_section(table, name, each), ""]
    return "\n".join(lines)


def leaderboard(kept: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """One table of all drivers of the suite, the best total in the paper's cell first.

    Args:
        kept: Results of `readygo benchmark run`, by the names of their files.

    Raises:
        ValueError: If a file is of another suite.
    """
    if not kept:
        return []
    suite = open_suite(PEDESTRIAN_NAV)
    if other := [name for name, each in kept.items() if each["suite_sha256"] != suite.sha256]:
        raise ValueError(f"{other[0]} is not of the suite {PEDESTRIAN_NAV}.")
    cell = suite.suite.paper_cell
    drivers = [(name, driver) for name, each in kept.items() for driver in each["drivers"]]
    drivers.sort(key=lambda place: -kept[place[0]]["cells"][cell][place[1]]["total"]["mean"])
    titles = ["driver", *IN_PAPER_CELL, "SR % of all cells", *INPUT_TITLES, "Training seeds", "Episodes per cell"]
    return [
        f"## Leaderboard of {suite.suite.name}\n",
        f"Total, SR, SPL and PSC in the cell `{cell}`, where the paper's figures are comparable; beside them the mean "
        "SR of all cells. [What the cells and columns are](benchmark.md), [results](results/benchmark.md).\n",
        f"From {', '.join(f'`benchmarks/results/{name}`' for name in kept)}.\n",
        f"| {' | '.join(titles)} |",
        "|---" * len(titles) + "|",
        *(f"| {' | '.join(_leaderboard_row(kept[name], driver, cell))} |" for name, driver in drivers),
        "",
    ]


def _leaderboard_row(kept: Mapping[str, Any], driver: str, cell: str) -> list[str]:
    scores = kept["cells"][cell][driver]
    inputs = section_from_mapping(DriverInputs, kept["drivers"][driver]["inputs"])
    rates = [each[driver]["success"]["mean"] for each in kept["cells"].values()]
    return [
        f"`{driver}`",
        *(_cell(scores[measure], factor) for measure, factor in IN_PAPER_CELL.values()),
        f"{100.0 * sum(rates) / len(rates):.0f}",
        *input_cells(inputs),
        # A driver is one policy; the files have no rows of several.
        "1" if inputs.learns else "",
        str(kept["episodes"]),
    ]


def _section(table: Table, name: str, kept: Mapping[str, Any]) -> Iterator[str]:
    machine = ", ".join(f"{key} {value}" for key, value in kept.get("machine", {}).items())
    yield f"## `{table.title}`\n"
    if note := kept.get("note"):
        yield f"{note}\n"
    yield f"From `benchmarks/results/{name}` ({machine}).\n"
    references = list(dict.fromkeys(found["reference"] for found in table.comparisons))
    titles = ["task", "method", *COLUMNS, "episodes", *(f"beside {name}" for name in references)]
    yield f"| {' | '.join(titles)} |"
    yield "|---" * len(titles) + "|"
    beside = {(found["task"], found["method"], found["reference"]): found for found in table.comparisons}
    for task, methods in table.measures.items():
        for method, measures in methods.items():
            cells = [_cell(measures.get(measure), factor) for measure, factor in COLUMNS.values()]
            count = measures["success"]["count"]
            compared = [_beside(beside.get((task, method, reference)), count) for reference in references]
            yield f"| {' | '.join([task, method, *cells, str(count), *compared])} |"


def _beside(found: Mapping[str, Any] | None, count: int) -> str:
    """A comparison; with the number of its episodes where the method drove more than these."""
    if found is None:
        return ""
    both = found.get("episodes", count)
    of = "" if both >= count else f" (of {both})"
    return f"+{found['only_method']} -{found['only_reference']}{of}, p {found['mcnemar_p']:.2g}"


def _cell(score: Mapping[str, Any] | None, factor: float) -> str:
    if score is None or score["mean"] is None:
        return ""
    digits = 0 if factor == 100.0 else 2
    mean, low, high = (f"{score[key] * factor:.{digits}f}" if key in score else "" for key in ("mean", "low", "high"))
    return f"{mean} ({low} to {high})" if low else mean


def _measures_of_scores(scores: Mapping[str, Any]) -> Measures:
    """The scores of a run that learned, by the names that evaluations have today."""
    return {
        task: {method: _measures_of_method(found) for method, found in methods.items()}
        for task, methods in scores.items()
    }


def _measures_of_method(found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    success = {"mean": found["success_rate"], "low": found["success_rate_low"], "high": found["success_rate_high"]}
    names = [measure for measure, _ in COLUMNS.values() if measure != "success"]
    others = {name: {"mean": found[OF_SCORES.get(name, name)]} for name in names}
    return {"success": {**success, "count": found["episode_count"]}, **others}


def readme(text: str, results: Path) -> str:
    """The text of README.md with its table written again.

    Args:
        text: As it stands.
        results: Folder of kept runs.
    """
    found = {title: json.loads((results / name).read_text())["measures"] for title, name in IN_README.items()}
    columns = {f"{task}, {title}": methods for title, tasks in found.items() for task, methods in tasks.items()}
    lines = [f"| SR % | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for method in next(iter(columns.values())):
        cells = [_cell(methods[method]["success"], 100.0) for methods in columns.values()]
        lines.append(f"| `{method}` | {' | '.join(cells)} |")
    before, _, rest = text.partition(BEGIN)
    return before + BEGIN + "".join(f"{line}\n" for line in lines) + END + rest.partition(END)[2]


def main() -> None:
    """Write page and README.md."""
    PAGE.write_text(page(RESULTS))
    README.write_text(readme(README.read_text(), RESULTS))
    sys.stdout.write(f"{PAGE.relative_to(ROOT)}\n{README.relative_to(ROOT)}\n")


if __name__ == "__main__":
    main()
