from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.reconstruction.poses import shape_rmse_m
from readygo.services.reconstructor.poses.colmap import read_map
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.covariance import pose_errors
from readygo.services.reconstructor.similarity import umeyama

pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
LENS_KNOWN = PosesConfig(intrinsics="given")


def adjusted(folder: Path, seed: int, noise_px: float = 0.5) -> tuple[Any, Path]:
    """A true map of ten images, and where one lies that was adjusted to its noisy matches."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 1, 10, 60
    pycolmap.set_random_seed(seed)
    true = pycolmap.synthesize_dataset(options)
    noisy = pycolmap.Reconstruction(true)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = noise_px
    pycolmap.synthesize_noise(noise, noisy)
    quiet = pycolmap.BundleAdjustmentOptions()
    quiet.print_summary, quiet.refine_focal_length, quiet.refine_extra_params = False, False, False
    pycolmap.bundle_adjustment(noisy, quiet)
    noisy.update_point_3d_errors()
    folder.mkdir()
    noisy.write(folder)
    return true, folder


def test_residuals_say_how_far_poses_of_independent_matches_are_off(tmp_path: Path) -> None:
    ratios = []
    for seed in range(6):
        true, model = adjusted(tmp_path / str(seed), seed)
        errors = pose_errors(model, [image.name for image in true.images.values()], LENS_KNOWN)
        assert errors is not None
        found = read_map(model)
        places = {image.name: image.projection_center() for image in true.images.values()}
        true_m = np.array([places[name] for name in found.names])
        fit = umeyama(found.T_world_camera[:, :3, 3], true_m)
        off = np.linalg.norm(fit.apply(found.T_world_camera[:, :3, 3]) - true_m, axis=1)
        ratios.append(np.sqrt((off**2).mean()) / (fit.scale * shape_rmse_m(found.T_world_camera, errors)))
    assert 0.85 < np.mean(ratios) < 1.2


def test_lens_that_is_known_adds_no_error(tmp_path: Path) -> None:
    true, model = adjusted(tmp_path / "map", 0)
    names = [image.name for image in true.images.values()]
    free, fixed = (pose_errors(model, names, config) for config in (PosesConfig(), LENS_KNOWN))
    assert free is not None
    assert fixed is not None
    assert np.trace(fixed.covariance) < 0.9 * np.trace(free.covariance)
    prior = pose_errors(model, names, replace(LENS_KNOWN, intrinsics_are="prior"))
    assert prior is not None
    np.testing.assert_allclose(prior.covariance, free.covariance)


def test_images_that_are_not_asked_for_are_left_out(tmp_path: Path) -> None:
    true, model = adjusted(tmp_path / "map", 0)
    names = sorted(image.name for image in true.images.values())
    few = pose_errors(model, names[:4], PosesConfig())
    assert few is not None
    assert few.names == tuple(names[:4])
    assert few.covariance.shape == (24, 24)


def test_map_without_points_tells_nothing(tmp_path: Path) -> None:
    true, model = adjusted(tmp_path / "map", 0)
    rec = pycolmap.Reconstruction(model)
    for number in list(rec.points3D):
        rec.delete_point3D(number)
    rec.write(model)
    assert pose_errors(model, [image.name for image in true.images.values()], PosesConfig()) is None
