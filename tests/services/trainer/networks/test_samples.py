"""Which images, goals and places a network is shown."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.services.trainer.networks import samples  # noqa: E402
from readygo.services.trainer.networks.config import GOAL_LOOKS_MAX  # noqa: E402


def looks(*counts: int) -> samples.Looks:
    """Trajectories one after the other, each along a circle."""
    sizes = np.array(counts)
    begins = np.cumsum(sizes) - sizes
    angle = np.concatenate([np.arange(count) * 0.1 for count in counts])
    return samples.Looks(
        rows=np.arange(sizes.sum()) * 5,
        first=np.repeat(begins, sizes),
        last=np.repeat(begins + sizes - 1, sizes),
        xyyaw=np.stack([np.sin(angle), 1 - np.cos(angle), angle], axis=1),
        unit_m=0.25,
    )


def test_goals_are_ahead_in_the_same_trajectory_or_in_another_one() -> None:
    of = looks(30, 8, 50)
    choice = samples.choose(of, 4000, np.random.default_rng(0))
    same = of.first[choice.goals] == of.first[choice.looks]
    np.testing.assert_array_equal(same, ~choice.other)
    ahead = (choice.goals - choice.looks)[same]
    np.testing.assert_array_equal(ahead, choice.distances[same])
    assert (ahead.min(), ahead.max()) == (1, GOAL_LOOKS_MAX)
    assert (choice.distances[choice.other] == GOAL_LOOKS_MAX).all()
    assert 0.02 < choice.other.mean() < 0.2
    # The last look of a trajectory has nothing ahead.
    assert choice.other[choice.looks == of.last[choice.looks]].all()


def test_places_are_in_the_frame_of_the_robot_and_in_its_unit() -> None:
    of = looks(30)
    places = samples.places_of(of, np.array([0, 12]), 5)
    np.testing.assert_allclose(places[0], places[1], atol=1e-6)
    np.testing.assert_allclose(places[0, :, 0] * 0.25, np.sin(0.1 * np.arange(1, 6)), atol=1e-6)
    assert (places[0, :, 1] > 0).all(), "a left turn ends on the left"
    angles = 0.1 * np.arange(1, 6)
    np.testing.assert_allclose(places[0, :, 2:], np.stack([np.cos(angles), np.sin(angles)], 1), atol=1e-6)


def test_at_the_end_the_robot_stays() -> None:
    of = looks(10, 10)
    places = samples.places_of(of, np.array([8, 9]), 3)
    np.testing.assert_array_equal(places[0, 0], places[0, 2])
    np.testing.assert_allclose(places[1], [[0, 0, 1, 0]] * 3)


class Shown:
    """Images that are the number of their look."""

    def of(self, rows: np.ndarray):
        return torch.from_numpy(rows.astype(np.float32))


def test_window_begins_with_the_first_image_of_its_trajectory() -> None:
    of = looks(10, 10)
    choice = samples.Choice(
        looks=np.array([11, 17]), goals=np.array([15, 3]), distances=np.array([4, 20]), other=np.array([False, True])
    )
    batch = samples.make_batch(of, Shown(), choice, frames=4, places=5)  # type: ignore[arg-type]
    assert batch.images.tolist() == [[10, 10, 10, 11], [14, 15, 16, 17]]
    assert batch.goals.tolist() == [15, 3]
    assert batch.places.shape == (2, 5, 4)
