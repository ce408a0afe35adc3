from pathlib import Path

import cv2
import numpy as np

from readygo.services.reconstructor.frames.depths import read_steps, to_steps


def test_depths_are_kept_to_a_millimetre_and_far_ones_are_unmeasured(tmp_path: Path) -> None:
    depth_m = np.array([[0.0, 1.2344], [65.5, 65.6]])
    cv2.imwrite(str(tmp_path / "a.png"), to_steps(depth_m))
    steps = read_steps(tmp_path / "a.png")
    assert steps is not None
    assert steps.tolist() == [[0, 1234], [65500, 0]]


def test_what_is_no_depth_image_is_none(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), np.ones((4, 4), np.uint8))
    assert read_steps(tmp_path / "grey.png") is None
    assert read_steps(tmp_path / "missing.png") is None
