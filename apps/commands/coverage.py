"""`readygo coverage`: which places, encounters and motions a dataset covers."""

import json as json_module
import sys
from pathlib import Path

from readygo.apps.report.coverage import coverage_page, heat_map
from readygo.apps.report.coverage_numbers import casts_of, measure
from readygo.apps.report.coverage_run import gather, page_numbers
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.recorded import recorded_map
from readygo.common.dataset import Dataset, recorded_clarity
from readygo.common.drawing.files import write_png
from readygo.common.files import write_whole

PAGE_FILE, NUMBERS_FILE = "coverage.html", "coverage.json"
MAP_FILE, SHARPNESS_FILE = "visits.png", "sharpness.png"


def coverage(data: Path, /, *, out: Path, scene: str = "", json: bool = False) -> None:
    """Count where robots drove, which pedestrians they met and how they moved, and show it on one page.

    Args:
        data: Data folder.
        out: Folder for coverage.html, coverage.json, visits.png and sharpness.png.
        scene: Scene bundle, "embedded", or a ROS map (.yaml) to draw on; by default the run's scene, if it is
            available.
        json: Print the numbers as JSON.
    """
    dataset = Dataset([data])
    casts = casts_of(dataset)
    measured = measure(dataset, casts)
    facts = gather(data, dataset, casts, measured, scene)
    numbers = page_numbers(measured, facts, dataset)
    clarity = recorded_clarity(dataset)
    numbers["clarity"] = clarity.to_mapping()
    heat = heat_map(measured.visits, facts.occupancy)
    sharp = recorded_map(dataset, clarity, facts.occupancy)
    html = coverage_page(measured, facts, heat, sharp)
    write_png(out / MAP_FILE, heat)
    write_png(out / SHARPNESS_FILE, sharp)
    write_whole(out / NUMBERS_FILE, json_module.dumps(numbers, indent=2) + "\n")
    write_whole(out / PAGE_FILE, html)
    if json:
        sys.stdout.write(json_module.dumps(numbers) + "\n")
    else:
        PlainConsole(soft_wrap=True).print(f"Open {out / PAGE_FILE}.", markup=False)
