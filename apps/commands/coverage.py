"""`readygo coverage`: which places, encounters and motions a dataset covers."""

import json as json_module
import sys
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.report.coverage import coverage_page, heat_map
from readygo.apps.report.coverage_numbers import casts_of, measure
from readygo.apps.report.coverage_run import gather, page_numbers
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.recorded import recorded_map
from readygo.common.dataset import Dataset, recorded_clarity
from readygo.common.drawing.files import write_png
from readygo.common.files import write_whole
from readygo.runs.trained import check_out

PAGE_FILE, NUMBERS_FILE = "coverage.html", "coverage.json"
MAP_FILE, SHARPNESS_FILE = "visits.png", "sharpness.png"


@dataclass(frozen=True, kw_only=True)
class CoverageOptions:
    """Count where robots drove, which pedestrians they met and how they moved, and show it on one page."""

    data: Positional[Path]
    """Data folder."""
    out: Path
    """Folder for coverage.html, coverage.json, visits.png and sharpness.png."""
    scene: str = ""
    """Scene bundle, "embedded", or a ROS map (.yaml) to draw on; by default the run's scene, if it is available."""
    json: bool = False
    """Print the numbers as JSON."""


def coverage(options: CoverageOptions) -> None:
    """Count where robots drove, which pedestrians they met and how they moved, and show it on one page."""
    check_out(options.out)
    dataset = Dataset([options.data])
    casts = casts_of(dataset)
    measured = measure(dataset, casts)
    facts = gather(options.data, dataset, casts, measured, options.scene)
    numbers = page_numbers(measured, facts, dataset)
    clarity = recorded_clarity(dataset)
    numbers["clarity"] = clarity.to_mapping()
    heat = heat_map(measured.visits, facts.occupancy)
    sharp = recorded_map(dataset, clarity, facts.occupancy)
    html = coverage_page(measured, facts, heat, sharp)
    write_png(options.out / MAP_FILE, heat)
    write_png(options.out / SHARPNESS_FILE, sharp)
    write_whole(options.out / NUMBERS_FILE, json_module.dumps(numbers, indent=2) + "\n")
    write_whole(options.out / PAGE_FILE, html)
    if options.json:
        sys.stdout.write(json_module.dumps(numbers) + "\n")
    else:
        PlainConsole(soft_wrap=True).print(f"Open {options.out / PAGE_FILE}.", markup=False)
