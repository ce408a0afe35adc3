from types import SimpleNamespace

import numpy as np
import pytest

from readygo.apps.monitor.splats import dolls_house, most_covering, splats_of
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.maps import FloorMap, OccupancyMap


def make_cloud(count: int) -> GaussianCloud:
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(count, 4))
    return GaussianCloud(
        means_m=rng.uniform([-0.9, -0.9, 0.0], [1.9, 1.9, 3.0], (count, 3)).astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales_m=rng.uniform(0.01, 0.1, (count, 3)).astype(np.float32),
        opacities=rng.uniform(0.1, 1.0, count).astype(np.float32),
        sh=rng.uniform(-1, 1, (count, 1, 3)).astype(np.float32),
    )


def test_gaussians_keep_shape_and_colour() -> None:
    cloud = make_cloud(50)
    splats = splats_of(cloud)
    for covariance, scales in zip(splats.covariances_m2, cloud.scales_m, strict=True):
        np.testing.assert_allclose(np.linalg.eigvalsh(covariance), np.sort(scales) ** 2, rtol=1e-3)
    np.testing.assert_allclose(splats.rgb, np.clip(0.5 + SH_C0 * cloud.sh[:, 0], 0, 1), atol=1e-6)
    assert splats.opacities.shape == (50, 1)


def test_those_that_cover_most_are_kept() -> None:
    cloud = make_cloud(50)
    kept = most_covering(cloud, 10)
    assert len(kept) == 10
    scales = np.sort(cloud.scales_m, axis=1)
    cover = cloud.opacities * scales[:, 1] * scales[:, 2]
    assert set(kept.opacities.tolist()) == set(cloud.opacities[np.argsort(-cover)[:10]].tolist())
    assert most_covering(cloud, 50) is cloud


def test_roof_comes_off_above_the_local_floor(room: OccupancyMap) -> None:
    floor = FloorMap(frame=room.frame, height_m=np.full(room.occupied.shape, 0.5, np.float32))
    scene = SimpleNamespace(cloud=make_cloud(200), maps=SimpleNamespace(robot=room, floor=floor))
    house = dolls_house(scene)  # type: ignore[arg-type]
    assert house.open.centers_m[:, 2].max() <= 2.3 < house.roof.centers_m[:, 2].min()
    assert len(house.open.centers_m) + len(house.roof.centers_m) == 200
    np.testing.assert_allclose(house.center_m, [0.5, 0.5, 0.5], atol=0.06)
    assert house.radius_m == pytest.approx(2.0, abs=0.15)
