import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "module",
    [
        "readygo",
        "readygo.common",
        "readygo.common.messages",
        "readygo.common.robot",
        "readygo.common.maps",
        "readygo.common.episode.config",
        "readygo.common.bus",
        "readygo.apps.cli",
    ],
)
def test_import_is_light(module: str) -> None:
    code = f"import sys, {module}; print(sorted({{'torch', 'zenoh', 'cv2', 'onnxruntime', 'mcap'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
