from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from readygo.services.reconstructor.metric.drift import CORRELATED, PoseErrors, drift, images_to_look_at
from readygo.services.reconstructor.metric.scale import marker_side
from readygo.services.reconstructor.posed import PosedImages
from tests.services.reconstructor.synthetic import floor_points, mapped, marker_at, ring, sighted, some_similarity

POSES = ring()
IMAGES = mapped(POSES, floor_points(30), some_similarity())
SEEN = sighted(POSES, marker_at(), 0)


def side(images: PosedImages) -> float:
    return marker_side(images, SEEN)


def moved(errors: np.ndarray) -> PosedImages:
    """The map with errors of its poses as `PoseErrors` has them, shape (V, 6)."""
    T = np.linalg.inv(IMAGES.T_world_camera)
    T[:, :3, :3] = Rotation.from_rotvec(errors[:, :3]).as_matrix() @ T[:, :3, :3]
    T[:, :3, 3] += errors[:, 3:]
    return replace(IMAGES, T_world_camera=np.linalg.inv(T))


def size(images: PosedImages) -> float:
    return float(np.sqrt(images.T_world_camera[:, :3, 3].var(axis=0).sum()))


def test_drift_is_the_spread_of_the_size_over_draws_of_poses() -> None:
    rng = np.random.default_rng(0)
    root = 1e-5 * rng.normal(size=(6 * len(POSES), 20))
    said = drift(IMAGES, PoseErrors(names=IMAGES.names, covariance=root @ root.T), side, set(IMAGES.names))
    draws = [moved((root @ rng.normal(size=20)).reshape(-1, 6)) for _ in range(300)]
    spread = np.std([np.log(side(images) / size(images)) for images in draws])
    assert said == pytest.approx(CORRELATED * spread, rel=0.15)
    loose = PoseErrors(names=IMAGES.names, covariance=1e10 * root @ root.T)
    assert drift(IMAGES, loose, side, set(IMAGES.names)) is None


def test_map_that_is_moved_turned_and_sized_as_a_whole_does_not_drift() -> None:
    T = np.linalg.inv(IMAGES.T_world_camera)
    R, t = T[:, :3, :3], T[:, :3, 3]
    zero = np.zeros_like(t)
    whole = [np.hstack([-R[:, :, k], zero]) for k in range(3)]
    whole += [np.hstack([zero, -R[:, :, k]]) for k in range(3)] + [np.hstack([zero, t])]
    root = 0.01 * np.stack([each.ravel() for each in whole], axis=1)
    said = drift(IMAGES, PoseErrors(names=IMAGES.names, covariance=root @ root.T), side, set(IMAGES.names))
    assert said is not None
    assert said < 1e-5
    one = np.zeros_like(root)
    one[3:6, 0] = 0.01
    errors = PoseErrors(names=IMAGES.names, covariance=one @ one.T)
    moves = drift(IMAGES, errors, side, set(IMAGES.names))
    assert moves is not None
    assert moves > 1e-3


def test_of_large_maps_some_images_are_looked_at_and_those_that_are_needed() -> None:
    names = tuple(f"{number:04d}" for number in range(1000))
    chosen = images_to_look_at(names, {"0001", "0500"})
    assert len(chosen) == 201
    assert {"0000", "0001", "0005", "0500"} <= set(chosen)
    assert 200 <= len(images_to_look_at(names, set(names[1:]))) <= 400
    assert images_to_look_at(names[:400], ()) == list(names[:400])


def test_length_is_measured_in_the_images_whose_errors_are_known() -> None:
    some = IMAGES.names[::2]
    covariance = 1e-6 * np.eye(6 * len(some))
    said = drift(IMAGES, PoseErrors(names=some, covariance=covariance), side, set(IMAGES.names))
    alone = drift(IMAGES.only(some), PoseErrors(names=some, covariance=covariance), side, set(some))
    assert said == pytest.approx(alone, rel=1e-9)
    assert said is not None
    assert said > 0
