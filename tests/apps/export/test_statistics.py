import cv2
import numpy as np
import pytest

from readygo.apps.export.statistics import merge_statistics, of_images, of_rows
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import jpeg


def test_merged_statistics_are_those_of_all_rows() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    parts = [{"a": of_rows(rows[:10])}, {"a": of_rows(rows[10:])}]
    both, whole = merge_statistics(parts)["a"], of_rows(rows)
    for name in ("min", "max", "mean", "std"):
        np.testing.assert_allclose(both[name], whole[name], rtol=1e-9)
    assert both["count"] == [50]
    assert set(both) == {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


def test_colours_are_shares_per_channel() -> None:
    found = of_images([jpeg(number) for number in range(20)])
    assert np.array(found["mean"]).shape == (3, 1, 1)
    assert 0.4 < np.mean(found["mean"]) < 0.6
    assert found["count"] == [8]


def test_damaged_image_is_said() -> None:
    with pytest.raises(DatasetError, match="damaged"):
        of_images([b"nothing"])


def test_statistics_are_those_of_their_definitions() -> None:
    rows = np.array([[0.5, -3.0], [2.5, 1.0], [9.0, 0.0], [-1.0, 7.0]])
    found = of_rows(rows)
    assert (found["min"], found["max"], found["count"]) == ([-1.0, -3.0], [9.0, 7.0], [4])
    assert found["mean"] == pytest.approx([2.75, 1.25])
    assert found["std"] == pytest.approx([np.sqrt(((rows[:, k] - rows[:, k].mean()) ** 2).mean()) for k in (0, 1)])
    assert found["q50"] == pytest.approx([1.5, 0.5])
    assert found["q90"] == pytest.approx([2.5 + 0.7 * 6.5, 1.0 + 0.7 * 6.0])
    assert of_rows(np.array([True, False]))["mean"] == [0.5]


def test_merged_quantiles_are_weighted_means_of_the_parts() -> None:
    parts = [{"a": of_rows(np.full((count, 1), value))} for count, value in ((1, 4.0), (3, 8.0))]
    both = merge_statistics(parts)["a"]
    assert both["q10"] == both["mean"] == pytest.approx([7.0])
    assert both["std"] == pytest.approx([np.sqrt(0.25 * 9 + 0.75 * 1)])


def test_colours_are_in_the_order_of_rgb_and_of_images_from_first_to_last() -> None:
    def plain(red: int, blue: int) -> bytes:
        picture = np.zeros((8, 8, 3), np.uint8)
        picture[..., 2], picture[..., 0] = red, blue
        return cv2.imencode(".png", picture)[1].tobytes()

    images = [plain(51, 102)] * 20
    images[0], images[-1] = plain(0, 102), plain(255, 102)
    found = of_images(images)
    np.testing.assert_allclose(np.ravel(found["mean"]), [(0 + 1 + 6 * 0.2) / 8, 0.0, 0.4])
    np.testing.assert_allclose(np.ravel(found["max"]), [1.0, 0.0, 0.4])
    assert of_images(images[:3])["count"] == [3]
