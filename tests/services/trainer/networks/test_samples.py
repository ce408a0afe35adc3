"""Which images, goals and places a network is shown."""

import dataclasses

import numpy as np
import pytest

from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from readygo.common.messages import DriverKind
from tests import crooked

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


def test_places_are_those_of_complex_numbers() -> None:
    rng = np.random.default_rng(4)
    poses = np.column_stack([rng.uniform(-5, 5, (30, 2)), rng.uniform(-4, 4, 30)])
    of = dataclasses.replace(looks(12, 18), xyyaw=poses, unit_m=0.23)
    present = np.array([3, 10, 14, 28])
    found = samples.places_of(of, present, 4)
    for row, look in enumerate(present.tolist()):
        for k in range(4):
            then = min(look + k + 1, int(of.last[look]))
            turn = np.exp(-1j * poses[look, 2])
            place = (complex(*poses[then, :2]) - complex(*poses[look, :2])) * turn / 0.23
            heading = np.exp(1j * poses[then, 2]) * turn
            expected = [place.real, place.imag, heading.real, heading.imag]
            assert found[row, k].tolist() == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("robot", "steps"), [(crooked.ROBOT, 5), (crooked.ODD_RATES, 8)])
def test_looks_are_the_experts_images_about_a_quarter_second_apart(tmp_path, robot, steps) -> None:
    writes = ((3, DriverKind.EXPERT), (5, DriverKind.POLICY), (8, DriverKind.EXPERT), (9, DriverKind.EXPERT))
    for index, driver in writes:
        changes = {"driver": driver, "policy": "" if driver is DriverKind.EXPERT else "5a" * 32}
        crooked.write_crooked_shard(tmp_path / str(index), (index,), 4 * steps + index, robot=robot, **changes)
    dataset = Dataset([tmp_path / str(index) for index, _ in writes])
    names = {entry.episode.episode_id for entry in dataset.episodes if entry.episode.index != 9}
    of = samples.looks_of(dataset, names)
    begin = {entry.episode.index: entry.first_sample for entry in dataset.episodes}
    counts = {index: len(range(0, 4 * steps + index, steps)) for index in (3, 8)}
    rows = [begin[index] + steps * k for index, count in counts.items() for k in range(count)]
    assert of.rows.tolist() == rows
    assert of.first.tolist() == [0] * counts[3] + [counts[3]] * counts[8]
    assert of.last.tolist() == [counts[3] - 1] * counts[3] + [len(rows) - 1] * counts[8]
    assert of.unit_m == pytest.approx(0.85 * steps / robot.clock.rate_hz)
    np.testing.assert_array_equal(of.xyyaw, dataset.poses[rows][:, [0, 1, 3]])
    with pytest.raises(DatasetError, match="two or more of the expert's episodes"):
        samples.looks_of(dataset, {name for name in names if name.endswith(("3", "5"))})


def test_trajectory_of_four_looks_teaches_and_a_shorter_one_does_not(tmp_path) -> None:
    changes = {"driver": DriverKind.EXPERT, "policy": ""}
    for index, count in ((3, 16), (8, 15), (9, 21)):
        crooked.write_crooked_shard(tmp_path / str(index), (index,), count, **changes)
    dataset = Dataset([tmp_path / str(index) for index in (3, 8, 9)])
    of = samples.looks_of(dataset, {entry.episode.episode_id for entry in dataset.episodes})
    assert of.rows.tolist() == [0, 5, 10, 15, 31, 36, 41, 46, 51]
