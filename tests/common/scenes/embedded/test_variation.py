"""Flats of other seeds: mirrored, recoloured, with more in the way, and still passable."""

import numpy as np
import pytest
from scipy import ndimage

from readygo.common.gaussians import GaussianCloud
from readygo.common.maps.distance import clearance_m
from readygo.common.maps.occupancy import MapConfig, plan_scene
from readygo.common.scenes.embedded.plan import FLAT
from readygo.common.scenes.embedded.scene import embedded_scene_cloud
from readygo.common.scenes.embedded.surfaces import Surfaces
from readygo.common.scenes.embedded.variation import Variation


@pytest.fixture(scope="module")
def other() -> GaussianCloud:
    return embedded_scene_cloud(5)


def reachable_m2(cloud: GaussianCloud) -> tuple[float, float]:
    """The largest connected area of a robot of 0.3 m, and that of all areas [m2]."""
    robot = plan_scene(cloud, MapConfig()).robot
    labels, count = ndimage.label(clearance_m(robot) > 0.3)
    sizes = ndimage.sum(labels > 0, labels, range(1, count + 1)) * robot.frame.resolution_m**2
    return float(sizes.max()), float(sizes.sum())


def test_first_flat_is_built_as_it_is() -> None:
    build = Variation(seed=0).surfaces()
    build.at(1.0, 2.0).patch((0, 0, 0), (1, 0, 0), (0, 0, 1), 0.5, (0.2, 0.4, 0.6))
    samples = build.samples()
    assert samples.position_m.min(axis=0).tolist() == [1.25, 2.0, 0.25]
    assert (samples.colour == (0.2, 0.4, 0.6)).all()
    Variation(seed=0).add_pieces(build)
    assert len(build.samples().position_m) == len(samples.position_m)


@pytest.mark.parametrize(("seed", "mirror"), [(1, (-1, 1)), (2, (1, -1)), (3, (-1, -1)), (4, (1, 1))])
def test_seeds_take_turns_with_the_ways_to_mirror_the_plan(seed: int, mirror: tuple[int, int]) -> None:
    build = Variation(seed=seed).surfaces()
    build.at(1.0, 2.0, yaw_deg=90).patch((0, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, (0.5, 0.5, 0.5))
    samples = build.samples()
    np.testing.assert_allclose(samples.position_m[0], [mirror[0] * 1.0, mirror[1] * 2.5, 0.5])
    # The patch faces +x before it is mirrored.
    np.testing.assert_allclose(samples.normal[0], [mirror[0], 0, 0], atol=1e-9)


def test_windows_are_where_the_mirrored_plan_has_them(cloud: GaussianCloud, other: GaussianCloud) -> None:
    mirror = Variation(seed=5).mirror
    window = next(o for o in FLAT.openings if o.is_window and o.wall == "east")
    wall = FLAT.walls["east"]
    for flat, sign in ((cloud, np.ones(2)), (other, mirror)):
        x, y, z = (flat.means_m * [*sign, 1.0]).T
        inside = (x > wall.low_m + 0.02) & (x < wall.high_m - 0.02) & (z > window.bottom_m + 0.1)
        pane = inside & (z < window.top_m - 0.1) & (y > window.begin_m + 0.1) & (y < window.end_m - 0.1)
        assert pane.sum() < 30


def test_other_flats_have_more_in_the_way_and_stay_whole(cloud: GaussianCloud, other: GaussianCloud) -> None:
    first, second = reachable_m2(cloud), reachable_m2(other)
    assert 25 < second[0] < first[0] - 1.0
    assert second[1] - second[0] < first[1] - first[0] + 0.5


def test_things_have_colours_of_their_own() -> None:
    build = Variation(seed=1).surfaces()
    for x in (0.0, 5.0):
        build.at(x, 0.0).patch((0, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, (0.7, 0.4, 0.3))
    build.at(0.0, 0.0).patch((0, 0, 2), (1, 0, 0), (0, 0, 1), 1.0, (0.9, 0.8, 0.5), glows=True)
    colours = build.samples().colour
    assert np.abs(colours[0] - colours[1]).max() > 0.02
    assert colours[2].tolist() == [0.9, 0.8, 0.5]
    assert ((colours >= 0) & (colours <= 1)).all()


def test_parts_of_one_thing_are_coloured_alike() -> None:
    build = Variation(seed=1).surfaces()
    thing = build.at(0.0, 0.0)
    for part in (thing, thing.at(1.0, 0.0)):
        part.patch((0, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, (0.7, 0.4, 0.3))
    colours = build.samples().colour
    assert isinstance(thing, Surfaces)
    np.testing.assert_array_equal(colours[0], colours[1])


def test_flat_of_another_seed_is_as_it_was(other: GaussianCloud, golden_figures) -> None:
    golden_figures("embedded/flat 5", other.means_m, other.quats_wxyz, 30.0 * other.scales_m, 3.0 * other.sh)
