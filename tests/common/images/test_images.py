from collections.abc import Sequence

import numpy as np
import pytest

from readygo.common.images.images import FIELDS, OUTPUTS, Images, empty_images, require_outputs


def test_memory_has_the_shape_and_type_of_every_image() -> None:
    images = empty_images(3, 4, 5, frozenset(OUTPUTS))
    shapes = {name: array.shape for name, array in images.arrays().items()}
    flat = dict.fromkeys(("depth_m", "median_depth_m", "alpha", "mask"), (3, 4, 5))
    assert shapes == {"rgb": (3, 4, 5, 3), **flat, "normal": (3, 4, 5, 3)}
    kinds = {array.dtype.name for name, array in images.arrays().items() if name not in ("rgb", "mask")}
    assert (images.rgb.dtype, images.arrays()["mask"].dtype, kinds) == (np.uint8, np.uint8, {"float32"})


def test_colours_are_always_there_and_others_only_if_wanted() -> None:
    assert empty_images(1, 4, 5, frozenset({"depth"})).arrays().keys() == {"rgb", "depth_m"}
    assert list(FIELDS) == list(OUTPUTS)


def test_images_of_one_view_are_views_of_the_batch() -> None:
    batch = empty_images(2, 4, 5, frozenset({"mask"}))
    one = batch[1]
    one.rgb[:], one.arrays()["mask"][:] = 7, 1
    assert isinstance(one, Images)
    assert (batch.rgb[1] == 7).all()
    assert (batch.arrays()["mask"][1] == 1).all()
    assert one.depth_m is None


@pytest.mark.parametrize("outputs", [("rgb", "colour"), "rgb"])
def test_unknown_names_are_refused(outputs: Sequence[str]) -> None:
    with pytest.raises(ValueError, match="outputs must be names out of rgb, depth"):
        require_outputs(outputs)
