"""`readygo evaluate --from-logs`: the table of a real robot's trials."""

import json as json_module
import sys
from pathlib import Path

from readygo.apps.drive.trials import Trial, mean_measures, read_trials
from readygo.apps.report.tables import latex
from readygo.apps.terminal import PlainConsole
from readygo.common.files import write_whole
from readygo.services.evaluator import (
    EpisodeRecord,
    failure_counts,
    score_mapping,
    scores_of,
    summarize_records,
    summary_mapping,
    summary_table,
)

TABLE_FILE, SUMMARY_FILE = "table.tex", "summary.json"


def evaluate_logs(folder: Path, out: Path | None, *, json: bool) -> None:
    """Print success rates, times to the goal and kinds of failure of trials, and write them.

    Args:
        folder: Folder with the logs.
        out: Folder for summary.json and table.tex.
        json: Print the summary as JSON.

    Raises:
        DatasetError: If there are no logs, or one cannot be read.
    """
    trials = read_trials(folder)
    records = [trial.record for trial in trials]
    limit_s = max(trial.time_limit_s for trial in trials)
    summaries = summarize_records(records, time_limit_s=limit_s)
    scores = scores_of(records, time_limit_s=limit_s)
    failures = {
        f"{task.value} {method}": {kind.value: count for kind, count in counts.items()}
        for (task, method), counts in failure_counts(records).items()
    }
    summary = {
        "scores": summary_mapping(summaries),
        "measures": score_mapping(scores),
        "failures": failures,
        "loop": mean_measures(trials),
        "trials": [{"log": trial.path.name, **trial.record.to_mapping()} for trial in trials],
    }
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / SUMMARY_FILE, json_module.dumps(summary, indent=2) + "\n")
        write_whole(out / TABLE_FILE, latex(scores))
    if json:
        sys.stdout.write(json_module.dumps(summary) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    table = summary_table(summaries)
    table.title = f"{len(trials)} trials"
    console.print(table)
    for name, kinds in failures.items():
        if kinds:
            said = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
            console.print(f"{name}: {said}", markup=False)
    for line in _reasons(trials):
        console.print(line, markup=False)
    _print_loop(console, mean_measures(trials))


def _reasons(trials: list[Trial]) -> list[str]:
    """A line with the reason for each trial that ended abnormally."""
    records: list[tuple[str, EpisodeRecord]] = [(trial.path.name, trial.record) for trial in trials]
    return [f"{name}: {record.reason}" for name, record in records if record.reason]


def _print_loop(console: PlainConsole, loop: dict[str, float]) -> None:
    if loop:
        console.print(
            f"inference {loop['inference_hz']:.1f} Hz ({loop['inference_hz_possible']:.0f} Hz possible), image to "
            f"command {loop['latency_median_ms']:.1f} ms, p99 {loop['latency_p99_ms']:.1f} ms"
        )
