import numpy as np
import pytest

from readygo.apps.pictures.shades import FARTHEST_M, NEAREST_M, shaded
from readygo.common.images.images import FIELDS, OUTPUTS
from tests.common.dataset.episodes import make_images


@pytest.mark.parametrize("kind", OUTPUTS)
def test_images_of_every_kind_become_colours(kind: str) -> None:
    images = make_images(1)
    picture = shaded(getattr(images, FIELDS[kind]), f"left.{kind}")
    assert (picture.shape, picture.dtype) == (images.rgb.shape, np.uint8)
    assert len(np.unique(picture)) > 1


def test_near_depths_are_brighter_and_nothing_is_black() -> None:
    depths_m = np.array([[NEAREST_M / 2, NEAREST_M, 1.0, 3.0, FARTHEST_M, 40.0, np.inf]], np.float32)
    light = shaded(depths_m, "depth")[0].astype(float).mean(axis=1)
    assert light[0] == light[1] > light[2] > light[3] > light[4] == light[5] > light[6] == 0.0
