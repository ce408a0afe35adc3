"""Changes lines of the product and tells which changes no test notices: `python -m tests.mutants --help`.

A changed line is a mutant; a test that fails kills it. The tree is copied, the user's files stay as they are.
"""

import argparse
import hashlib
import json
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Empty, SimpleQueue

from tests.mutants import places
from tests.mutants.operators import Mutation
from tests.mutants.report import EQUIVALENTS, KILLED, Report, fallen
from tests.mutants.trial import Bench

VERSION = 1
"""Changes when the same seed draws other mutants, or when they are judged in another way."""
ROOT = Path(__file__).resolve().parents[2]


def main(arguments: Sequence[str] | None = None, root: Path = ROOT) -> int:
    """Run the command; returns its exit code: 1 if survivors are news, 2 for a wrong call."""
    options = _parser().parse_args(arguments)
    files = places.tracked_files(root)
    mutants, mode = _mutants(options, root, places.product_files(root, files))
    header = {
        "program": VERSION,
        "commit": places.git(root, "rev-parse", "HEAD").strip(),
        "sources": _digest(root, files),
        "mode": mode,
        "limit_s": options.limit_s,
        "tests_max": options.tests_max,
    }
    equivalents = json.loads(EQUIVALENTS.read_text()) if EQUIVALENTS.exists() else []
    report = Report(header, options.out, equivalents)
    try:
        report.resume()
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    sys.stdout.write(f"{mode}: {len(mutants)} mutants, {len(report.entries)} of them tried out before\n")
    os.nice(options.nice)
    _try_out(mutants, report, root, files, options)
    return _judge(report, options)


def _mutants(options: argparse.Namespace, root: Path, product: list[str]) -> tuple[list[Mutation], str]:
    """What shall be tried out, and what to call it."""
    if options.known:
        return places.known(root, json.loads(options.known.read_text())["mutants"]), f"known {options.known.name}"
    if options.draw is not None and options.diff is None:
        lines: places.Lines = dict.fromkeys(product)
        if options.within:
            lines = {file: None for file in product if file.startswith(tuple(options.within))}
        within = f" within {' '.join(options.within)}" if options.within else ""
        return places.draw(root, lines, options.draw, options.seed), f"draw seed {options.seed}{within}"
    base = options.diff or places.default_base(root)
    changed = places.changed_lines(root, base)
    count = 40 if options.draw is None else options.draw
    lines = {file: changed[file] for file in product if file in changed}
    return places.draw(root, lines, count, options.seed), f"lines changed since {base[:12]}, seed {options.seed}"


def _try_out(
    mutants: Sequence[Mutation], report: Report, root: Path, files: Sequence[str], options: argparse.Namespace
) -> None:
    waiting: SimpleQueue[Mutation] = SimpleQueue()
    for mutant in mutants:
        if not report.has(mutant):
            waiting.put(mutant)
    lock, benches = threading.Lock(), []

    def work(bench: Bench) -> None:
        bench.set_up(root, files)
        while True:
            try:
                mutant = waiting.get_nowait()
            except Empty:
                return
            trial = bench.try_out(mutant)
            with lock:
                report.add(mutant, trial)
                where = f"{mutant.file}:{mutant.line}"
                sys.stdout.write(
                    f"{trial.result:9}{where}  [{mutant.operator}]  {mutant.before!r} -> {mutant.after!r}"
                    f"  {trial.killed_by}\n"
                )
                sys.stdout.flush()

    with ThreadPoolExecutor(options.jobs) as pool:
        try:
            for _ in range(min(options.jobs, waiting.qsize())):
                folder = Path(tempfile.mkdtemp(prefix="mutants-"))
                benches.append(Bench(folder, options.limit_s, options.tests_max, unchanged=report.unchanged))
            for result in [pool.submit(work, bench) for bench in benches]:
                result.result()
        finally:
            while not waiting.empty():
                waiting.get_nowait()
            for bench in benches:
                bench.close()


def _judge(report: Report, options: argparse.Namespace) -> int:
    report.write()
    summary = report.summary()
    survivors = [entry for entry in report.entries if entry["result"] not in KILLED and "equivalent" not in entry]
    sys.stdout.write(f"\n{json.dumps(summary)}\n")
    for entry in survivors:
        sys.stdout.write(
            f"{entry['result']}: {entry['file']}:{entry['line']}\n  - {entry['before']}\n  + {entry['after']}\n"
        )
    fails_anyway = sorted(test for test, run in report.unchanged.items() if run.verdict != "passed")
    if fails_anyway:
        sys.stdout.write(f"Not counted, they do not pass in the unchanged tree: {', '.join(fails_anyway)}\n")
    if options.baseline is None:
        return 0
    worse = fallen(report, json.loads(options.baseline.read_text()), same=options.known == options.baseline)
    sys.stderr.write("".join(f"{line}\n" for line in worse))
    return 1 if worse else 0


def _digest(root: Path, files: Sequence[str]) -> str:
    """Hash of all sources: a run is continued with the same ones alone."""
    digest = hashlib.sha256()
    for file in files:
        if file.endswith(".py"):
            digest.update(file.encode() + b"\0" + (root / file).read_bytes())
    return digest.hexdigest()[:16]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--diff",
        metavar="BASE",
        help="change lines that differ from this commit; by default from where the branch left main, from the latest "
        "tag, or from the commit before",
    )
    parser.add_argument(
        "--draw",
        type=int,
        metavar="N",
        help="draw N lines of the whole product, or with --diff of the changed ones (40)",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--within", nargs="+", metavar="FOLDER", help="draw from these folders alone")
    parser.add_argument("--known", type=Path, metavar="FILE", help="try out the mutants of an earlier report")
    parser.add_argument(
        "--baseline",
        type=Path,
        metavar="FILE",
        help="exit with 1 if a smaller share of the mutants is killed than in this report, or if one that it has as "
        "killed survives",
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="JSON report; an interrupted run goes on where its file ends"
    )
    parser.add_argument("--jobs", type=int, default=1, help="mutants at the same time")
    parser.add_argument(
        "--limit-s", type=float, default=240.0, help="processor time per mutant, and per process of its tests [s]"
    )
    parser.add_argument("--tests-max", type=int, default=8, help="files of tests per mutant")
    parser.add_argument("--nice", type=int, default=10, help="how far the run steps back behind other processes")
    return parser


if __name__ == "__main__":
    # A terminated run leaves no processes and no folders behind either.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    sys.exit(main())
