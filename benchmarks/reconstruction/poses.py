"""Poses of simulated captures beside the truth: camera and scale errors.

readygo scene capture SCENE --walk --out out/walk.mp4
readygo scene poses out/walk.mp4 --marker-size-m 0.2 --out out/lobby
python -m readygo.benchmarks.reconstruction.poses out/walk.truth.json out/lobby [--json]
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from readygo.apps.capture.compare import pose_errors
from readygo.apps.capture.truth import read_truth
from readygo.benchmarks.reconstruction.rows import print_row
from readygo.common.errors import SceneError
from readygo.services.reconstructor.job import POSED, REPORT_FILE
from readygo.services.reconstructor.poses import colmap


def measured(truth: Path, job: Path) -> dict[str, Any]:
    """Errors of what `readygo scene poses` left in a folder, and what it said of its scale.

    Raises:
        SceneError: If the folder holds no poses, or those of something else.
    """
    model = colmap.find_model(job / POSED)
    if model is None:
        raise SceneError(f"{job} holds no poses; run `readygo scene poses VIDEO --marker-size-m 0.2 --out {job}`.")
    found = colmap.read_map(model)
    errors = pose_errors(read_truth(truth), dict(zip(found.names, found.T_world_camera, strict=True)))
    report = json.loads((job / POSED / REPORT_FILE).read_text(encoding="utf-8"))
    said = {"interval_percent": report["scale"]["interval_percent"], "scale_by": report["scale"]["source"]}
    return {**errors.to_mapping(), **said}


def main() -> int:
    """Print the errors; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path, help="NAME.truth.json beside the capture")
    parser.add_argument("job", type=Path, help="folder of `readygo scene poses`")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    return print_row(lambda: measured(arguments.truth, arguments.job), as_json=arguments.json)


if __name__ == "__main__":
    sys.exit(main())
