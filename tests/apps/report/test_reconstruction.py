from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from readygo.apps.capture.compare import FoundPoseErrors
from readygo.apps.report.reconstruction import Reconstructed, photo_and_image, tiles
from readygo.common.drawing.files import write_png
from readygo.common.errors import RunError


def test_preview_loses_its_difference_and_grows(tmp_path: Path) -> None:
    preview = np.repeat(np.uint8([[10, 120, 250]]), 20, axis=1)[:, :, None].repeat(3, axis=2).repeat(15, axis=0)
    write_png(tmp_path / "a.png", preview)
    both = photo_and_image(tmp_path / "a.png")
    assert both.shape[1] >= 700
    assert both.shape[1] == 40 * both.shape[0] // 15
    assert set(both[:, both.shape[1] // 2 + 60 :].ravel().tolist()) == {120}
    with pytest.raises(RunError, match=r"b\.png cannot be read"):
        photo_and_image(tmp_path / "b.png")


def test_page_says_first_how_wrong_lengths_and_cameras_are(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text('{"robot": {"reachable_m2": 4.25}}')
    errors = FoundPoseErrors(
        images=9, of=10, scale_percent=-0.3, camera_rmse_m=0.012, shape_rmse_m=0.01, camera_max_m=0.02,
        rotation_deg=0.1, up_deg=0.2, height_m=0.0,
    )  # fmt: skip
    made = cast(
        "Reconstructed",
        SimpleNamespace(
            report={"training": {"psnr_db": 23.46}}, errors=errors, found=SimpleNamespace(path=tmp_path), seconds=600.0
        ),
    )
    assert [value for value, _ in tiles(made)] == ["-0.30 %", "1.2 cm", "23.5 dB", "4.2 m2", "10 min"]
