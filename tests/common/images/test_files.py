import dataclasses
import subprocess
import sys

import cv2
import numpy as np
import pytest

from readygo.common.images.files import decode_output, encode_output
from readygo.common.images.images import OUTPUTS, Images
from tests.common.dataset.episodes import make_images

IMAGES = make_images(0)


def depths(*values_m: float) -> Images:
    return dataclasses.replace(IMAGES, depth_m=np.array([values_m], dtype=np.float32))


def test_every_output_but_rgb_has_a_file() -> None:
    for name in OUTPUTS[1:]:
        assert encode_output(IMAGES, name).startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["depth", "median_depth"])
def test_depth_comes_back_within_half_a_millimetre(name: str) -> None:
    want = getattr(IMAGES, f"{name}_m")
    back = decode_output(name, encode_output(IMAGES, name))
    assert back is not None
    assert (back.dtype, back.shape) == (np.float32, want.shape)
    np.testing.assert_array_equal(np.isinf(back), np.isinf(want))
    seen = np.isfinite(want)
    np.testing.assert_allclose(back[seen], want[seen], atol=0.000505, rtol=0)


def test_depth_file_holds_millimetres_as_other_tools_expect_them() -> None:
    pixels = cv2.imdecode(
        np.frombuffer(encode_output(depths(0.05, 1.2344, 65.535, 65.5354, 65.536, 1800.0, np.inf), "depth"), np.uint8),
        cv2.IMREAD_UNCHANGED,
    )
    assert pixels.dtype == np.uint16
    assert pixels.tolist() == [[50, 1234, 65535, 65535, 0, 0, 0]]


def test_depth_that_is_not_a_number_is_nothing() -> None:
    back = decode_output("depth", encode_output(depths(np.nan, 2.0), "depth"))
    assert back is not None
    assert back.tolist() == [[np.inf, 2.0]]


def test_mask_comes_back_as_it_was() -> None:
    images = dataclasses.replace(IMAGES, mask=np.arange(256, dtype=np.uint8).reshape(16, 16))
    back = decode_output("mask", encode_output(images, "mask"))
    assert back is not None
    assert back.dtype == np.uint8
    np.testing.assert_array_equal(back, images.mask)


def test_alpha_comes_back_within_half_a_step() -> None:
    back = decode_output("alpha", encode_output(IMAGES, "alpha"))
    assert back is not None
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, IMAGES.alpha, atol=0.5 / 255 + 1e-6)
    ends = dataclasses.replace(IMAGES, alpha=np.array([[0.0, 1.0]], dtype=np.float32))
    assert np.array_equal(decode_output("alpha", encode_output(ends, "alpha")), [[0.0, 1.0]])


def test_normals_come_back_with_length_one_and_nothing_stays_nothing() -> None:
    back = decode_output("normal", encode_output(IMAGES, "normal"))
    assert back is not None
    assert back.dtype == np.float32
    np.testing.assert_allclose(back, IMAGES.normal, atol=0.006)
    nothing = (IMAGES.normal == 0).all(axis=2)
    assert nothing.any()
    assert (back[nothing] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(back[~nothing], axis=1), 1.0, atol=1e-5)


def test_normal_file_is_rgb() -> None:
    x_axis = np.zeros((2, 2, 3), dtype=np.float32)
    x_axis[..., 0] = 1.0
    data = encode_output(dataclasses.replace(IMAGES, normal=x_axis), "normal")
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert bgr[0, 0].tolist() == [128, 128, 255]


def test_image_that_was_not_drawn_is_refused() -> None:
    with pytest.raises(ValueError, match="the view has no mask image; ask for it"):
        encode_output(Images(rgb=IMAGES.rgb), "mask")


@pytest.mark.parametrize("name", OUTPUTS[1:])
def test_damaged_files_and_files_of_other_kinds_are_noticed(name: str) -> None:
    whole = encode_output(IMAGES, name)
    for data in (b"", b"no image at all", whole[:40]):
        assert decode_output(name, data) is None
    other = {"depth": "mask", "median_depth": "alpha", "normal": "depth"}.get(name, "normal")
    assert decode_output(name, encode_output(IMAGES, other)) is None


def test_same_image_gives_the_same_bytes() -> None:
    assert encode_output(IMAGES, "depth") == encode_output(dataclasses.replace(IMAGES), "depth")


def test_import_loads_no_opencv() -> None:
    code = "import sys, common.images.files; sys.exit(any(n in sys.modules for n in ('cv2', 'numba')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
