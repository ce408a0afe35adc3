from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.poses.colmap import open_model, posed_images
from readygo.services.reconstructor.poses.depths import DepthRatio, check_unit, depth_ratio
from tests.services.reconstructor.synthetic import synthetic_database

pytest.importorskip("pycolmap", reason="pycolmap is not installed")


def write_true_depths(folder: Path, longer: float, noise: float = 0.0) -> list[str]:
    """Depth images that have the depth of each point at its pixel, but for the last image; names of the images."""
    rec, rng = open_model(folder / "sparse"), np.random.default_rng(0)
    images = posed_images(rec)
    for image in images[:-1]:
        steps = np.zeros((60, 80), np.uint16)
        for point in image.points2D:
            if point.has_point3D():
                z = (image.cam_from_world() * rec.points3D[point.point3D_id].xyz)[2]
                u, v = np.floor(point.xy / 2).astype(int).clip(0, (79, 59))
                steps[v, u] = round(1000 * longer * z * np.exp(noise * rng.normal()))
        path = folder / "depth" / f"{image.name}.png"
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), steps)
    return [image.name for image in images]


def test_depths_are_compared_with_the_points_that_images_see(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    names = write_true_depths(tmp_path, 1.25)
    ratio = depth_ratio(tmp_path / "sparse", tmp_path / "depth")
    assert ratio is not None
    assert ratio.units_per_metre == pytest.approx(0.8, rel=1e-3)
    assert ratio.images == len(names) - 1
    assert ratio.sightings > 200
    assert ratio.spread < 1e-3


def test_too_few_depths_say_nothing(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    assert depth_ratio(tmp_path / "sparse", tmp_path / "depth") is None


def test_depths_of_something_else_are_refused(tmp_path: Path) -> None:
    synthetic_database(tmp_path)
    write_true_depths(tmp_path, 1.0, noise=0.6)
    with pytest.raises(SceneError, match=r"do not fit their images.*--frames\.depth false") as error:
        depth_ratio(tmp_path / "sparse", tmp_path / "depth")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("units_per_metre", [0.84, 1.0, 1.19])
def test_unit_of_depths_is_that_of_the_poses(units_per_metre: float) -> None:
    check_unit(DepthRatio(units_per_metre=units_per_metre, spread=0.01, sightings=99, images=9))
    for wrong in (0.2, 1000.0):
        with pytest.raises(SceneError, match=f"{1 / wrong:.3g} times as long as the same device's poses say"):
            check_unit(DepthRatio(units_per_metre=wrong, spread=0.01, sightings=99, images=9))
