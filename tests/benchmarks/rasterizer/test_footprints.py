import dataclasses

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.footprints import Work, count_work, footprints, pixel_stack
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.rasterizer.reference import rasterize_reference

K = np.array([[30.0, 0.0, 24.0], [0.0, 30.0, 16.0], [0.0, 0.0, 1.0]])
HEIGHT, WIDTH = 32, 48


def noise(count: int, z_m: tuple[float, float], scale_m: float) -> GaussianCloud:
    rng = np.random.default_rng(count)
    return GaussianCloud(
        means_m=rng.uniform((-2.0, -1.5, z_m[0]), (2.0, 1.5, z_m[1]), (count, 3)).astype(np.float32),
        quats_wxyz=rng.normal(size=(count, 4)).astype(np.float32),
        scales_m=(scale_m * rng.uniform(0.2, 1.0, (count, 3))).astype(np.float32),
        opacities=rng.uniform(0.1, 1.0, count).astype(np.float32),
        sh=rng.normal(scale=0.3, size=(count, 9, 3)).astype(np.float32),
    )


def work(cloud: GaussianCloud, scene_count: int | None = None) -> Work:
    prints = footprints(cloud, np.eye(4), K, HEIGHT, WIDTH)
    return count_work(prints, len(cloud) if scene_count is None else scene_count, HEIGHT, WIDTH)


@pytest.mark.parametrize("pixel", [(0, 0), (16, 24), (31, 47), (7, 40)])
def test_stack_of_a_pixel_adds_up_to_the_references_colour(pixel: tuple[int, int]) -> None:
    cloud = noise(800, (1.0, 4.0), 0.3)
    reference = rasterize_reference(cloud, np.eye(4), K, HEIGHT, WIDTH)
    stack = pixel_stack(footprints(cloud, np.eye(4), K, HEIGHT, WIDTH), cloud, np.eye(4), *pixel)
    weight = stack.alpha * stack.transmittance
    assert len(stack.index) > 3
    assert (np.diff(stack.depth_m) >= 0).all()
    np.testing.assert_allclose(weight @ stack.rgb, reference.rgb[pixel], atol=1e-5)
    assert weight.sum() == pytest.approx(reference.alpha[pixel], abs=1e-5)


def test_one_small_gaussian_is_one_entry_and_as_many_pairs_as_it_has_pixels() -> None:
    one = noise(1, (2.0, 2.0), 0.0)
    one = dataclasses.replace(one, means_m=np.array([[0.0, 0.0, 2.0]], dtype=np.float32))
    pixels = int((rasterize_reference(one, np.eye(4), K, HEIGHT, WIDTH).alpha > 0).sum())
    counted = work(one)
    assert (counted.visible, counted.drawn, counted.drawn_people) == (1, 1, 0)
    # Its centre lies on the border of two tiles and is the corner of four blocks.
    assert (counted.tile_entries, counted.block_entries, counted.pixel_pairs) == (2, 4, pixels)


def test_what_is_behind_a_wall_is_visible_but_not_drawn() -> None:
    wall, behind = noise(3000, (1.0, 1.2), 0.5), noise(500, (2.0, 3.0), 0.1)
    both, alone = work(concatenate([wall, behind])), work(wall)
    assert both.visible > alone.visible + 200
    assert both.drawn == alone.drawn
    assert both.pixel_pairs == alone.pixel_pairs


def test_gaussians_behind_the_camera_are_no_work() -> None:
    assert work(noise(50, (-4.0, -1.0), 0.1)).visible == 0


def test_humans_are_counted_apart() -> None:
    scene, person = noise(40, (3.0, 4.0), 0.05), noise(30, (1.0, 2.0), 0.05)
    counted = work(concatenate([scene, person]), scene_count=len(scene))
    assert counted.drawn_people == work(person).drawn
    assert 0 < counted.drawn_people < counted.drawn
