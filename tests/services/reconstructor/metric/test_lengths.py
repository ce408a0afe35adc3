import numpy as np
import pytest

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.metric.lengths import in_used_images, measured_length, parse_length
from tests.services.reconstructor.synthetic import floor_points, mapped, projected, ring, some_similarity

POSES = ring()
IMAGES = mapped(POSES, floor_points(30), some_similarity())
ENDS = np.array([[-0.5, 0.0, 0.0], [0.4, 0.2, 0.3]])


def picked(views: tuple[int, ...], length_m: float) -> str:
    words = []
    for view in views:
        words += [f"{view:06d}.jpg:{u:.6f},{v:.6f}" for u, v in projected(POSES[view], ENDS)]
    return f"{' '.join(words)} = {length_m}"


def test_length_is_measured_in_units_of_the_map() -> None:
    length, sigma = measured_length(IMAGES, parse_length(picked((0, 4, 8), 1.0)))
    np.testing.assert_allclose(length, some_similarity().scale * np.linalg.norm(ENDS[1] - ENDS[0]), rtol=1e-6)
    assert 0.0005 < sigma < 0.01


@pytest.mark.parametrize(
    "text",
    ["", "a.jpg:1,2 a.jpg:3,4 = 1", "a.jpg:1,2 b.jpg:3,4 a.jpg:1,1 b.jpg:2,2 = 1", "a:1,2 a:3,4 b:1,2 b:3,4 = 0",
     "a:1,2 a:3,4 b:1,2 b:3,4", "a:1 a:3,4 b:1,2 b:3,4 = 2"],
)  # fmt: skip
def test_other_forms_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--length"):
        parse_length(text)


def test_picks_of_different_points_are_refused() -> None:
    text = picked((0, 3), 1.0).replace("000003.jpg:", "000006.jpg:")
    with pytest.raises(SceneError, match=r"miss each other|only|cannot be placed"):
        measured_length(IMAGES, parse_length(text))


def test_image_without_a_pose_is_named() -> None:
    with pytest.raises(SceneError, match=r"x\.jpg, which has no pose"):
        measured_length(IMAGES, parse_length("x.jpg:1,2 x.jpg:3,4 000001.jpg:1,2 000001.jpg:3,4 = 1"))


def test_picks_in_large_photos_are_those_in_the_smaller_ones_that_are_used() -> None:
    told = parse_length("a.png:100,40 a.png:20,60 b.JPG:8,4 b.JPG:2,6 = 1")
    used = in_used_images(told, {"a.png": ("a.jpg", 0.25), "b.JPG": ("b.jpg", 0.5), "a.jpg": ("a.jpg", 1.0)})
    assert used.ends == ((("a.jpg", 25.0, 10.0), ("b.jpg", 4.0, 2.0)), (("a.jpg", 5.0, 15.0), ("b.jpg", 1.0, 3.0)))
    with pytest.raises(ConfigError, match=r"a\.png, which is no image here; there are c\.jpg"):
        in_used_images(told, {"c.jpg": ("c.jpg", 1.0)})


def test_uncertainty_of_a_length_is_at_least_the_spread_of_noisy_picks_and_not_twice_that() -> None:
    rng, lengths, said = np.random.default_rng(0), [], []
    for _ in range(150):
        words = [
            f"{view:06d}.jpg:{u + rng.normal():.6f},{v + rng.normal():.6f}"
            for view in (0, 3, 7)
            for u, v in projected(POSES[view], ENDS)
        ]
        length, sigma = measured_length(IMAGES, parse_length(f"{' '.join(words)} = 1"))
        lengths.append(np.log(length))
        said.append(sigma)
    assert 1.0 < np.mean(said) / np.std(lengths) < 1.7
