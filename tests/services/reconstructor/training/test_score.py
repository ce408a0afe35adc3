"""Scores of held-out photos."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from readygo.services.reconstructor.training.drawing import draw, leaves_of, planes_of
from readygo.services.reconstructor.training.photos import PhotoStore, open_posed
from readygo.services.reconstructor.training.score import measure, write_picture
from tests.services.reconstructor.training.conftest import SIZE_PX, camera, true_gaussians


def test_the_truth_scores_best_and_is_pictured_beside_its_photo(
    write_posed: Callable[[Path], Path], tmp_path: Path
) -> None:
    posed = open_posed(write_posed(tmp_path / "posed"), tmp_path / "undistorted")
    gaussians, photos = true_gaussians(), PhotoStore(posed, (1, 4), 1000, 1)
    right = measure(gaussians, photos, 0)
    assert [score.image for score in right] == ["1.png", "4.png"]
    # Eight bits round away what is left.
    assert all(score.psnr_db > 50 and score.ssim > 0.999 for score in right)
    assert all(score.psnr_fitted_db >= score.psnr_db - 1e-6 for score in right)
    gaussians.values["means_m"] += 0.1
    assert measure(gaussians, photos, 0)[0].psnr_db < 30
    write_picture(tmp_path / "picture.png", right[0])
    picture = cv2.imread(str(tmp_path / "picture.png"))
    assert picture.shape == (SIZE_PX[0], 3 * SIZE_PX[1], 3)
    assert picture[:, -SIZE_PX[1] :].max() < 16
    np.testing.assert_allclose(planes_of(draw(leaves_of(true_gaussians()), camera(1), 0)), right[0].rendered, atol=1e-6)
    assert measure(gaussians, None, 0) == []


def test_what_is_masked_does_not_count(write_posed: Callable[[Path], Path], tmp_path: Path) -> None:
    folder = write_posed(tmp_path / "posed")
    photo = cv2.imread(str(folder / "images" / "1.png"))
    photo[:, :20] = 255
    cv2.imwrite(str(folder / "images" / "1.png"), photo)
    posed = open_posed(folder, tmp_path / "undistorted")
    (bad,) = measure(true_gaussians(), PhotoStore(posed, (1,), 1000, 1), 0)
    mask = np.full(SIZE_PX, 255, np.uint8)
    mask[:, :20] = 0
    (folder / "masks").mkdir()
    for number in range(6):
        cv2.imwrite(str(folder / "masks" / f"{number}.png.png"), mask)
    posed = open_posed(folder, tmp_path / "undistorted")
    (good,) = measure(true_gaussians(), PhotoStore(posed, (1,), 1000, 1), 0)
    assert bad.psnr_db < 15 < 50 < good.psnr_db
    assert bad.ssim < 0.8
    assert good.ssim > 0.999
    assert good.psnr_fitted_db >= good.psnr_db
