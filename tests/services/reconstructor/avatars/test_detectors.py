"""Networks of users find masks and keypoints where they are in the image; other networks are refused in words."""

from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto, helper

from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars.detectors import (
    BOX_SCALE,
    KeypointNetwork,
    MaskNetwork,
    box_of_mask,
    crop_box,
    decode_heatmaps,
    decode_simcc,
    person_share,
)
from tests.services.reconstructor.avatars.networks import write_brightest, write_brightness, write_network

SPOT = 61.0, 90.0


def _image() -> np.ndarray:
    """A person with one bright spot, whose centre is `SPOT`, shape (160, 120, 3)."""
    image = np.full((160, 120, 3), 20, dtype=np.uint8)
    image[30:130, 40:80] = 90
    image[87:93, 58:64] = 255
    return image


def _mask() -> np.ndarray:
    return np.asarray(_image()[..., 0] > 50)


@pytest.mark.parametrize("simcc", [True, False])
@pytest.mark.parametrize("count", [17, 26])
def test_keypoints_are_where_the_network_sees_them(tmp_path: Path, simcc: bool, count: int) -> None:
    network = KeypointNetwork(write_brightest(tmp_path / "net.onnx", (256, 192), count, simcc=simcc))
    found = network.find(_image(), _mask())
    assert found.shape == (count, 3)
    # The spot is 12 px wide in the input: its first pixel is as bright as its middle.
    np.testing.assert_allclose(found[:, :2], np.tile(SPOT, (count, 1)), atol=3.5)
    assert (found[:, 2] > 0.8).all()


def test_classes_and_peaks_are_decoded_to_pixel_centres() -> None:
    x, y = np.zeros((1, 30)), np.zeros((1, 80))
    x[0, 12], y[0, 60] = 0.9, 0.7
    np.testing.assert_allclose(decode_simcc(x, y, 10, 20), [[12 / 3 + 0.5, 60 / 4 + 0.5, 0.7]])
    maps = np.zeros((2, 4, 5))
    maps[0, 2, 3], maps[0, 2, 4], maps[0, 1, 3] = 0.8, 0.4, 0.2
    maps[1, 0, 0], maps[1, 0, 1] = 0.6, 0.1
    found = decode_heatmaps(maps, 10, 16)
    np.testing.assert_allclose(found[0], (2 * (3 + 0.25) + 0.5, 4 * (2 - 0.25) + 0.5, 0.8))
    assert (found[1, :2] >= 0.0).all(), "at the border"
    assert (found[1, :2] < (2.0, 4.0)).all()


def test_peaks_are_where_heatmaps_of_published_networks_have_their_keypoints() -> None:
    """HRNet, SimpleBaseline and mmpose's MSRAHeatmap: a Gaussian at the cell int(p / stride + 0.5) of pixel index p."""
    size, stride, sigma = np.array([48, 64]), 4.0, 2.0
    x, y = np.arange(size[0]), np.arange(size[1])[:, None]

    def decoded(pixels: np.ndarray) -> np.ndarray:
        cells = np.floor(pixels / stride + 0.5)
        maps = [np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * sigma**2)) for u, v in cells]
        return decode_heatmaps(np.array(maps), 192, 256)[:, :2]

    rng = np.random.default_rng(0)
    on_cells = stride * rng.integers(0, size, (40, 2))
    np.testing.assert_allclose(decoded(on_cells), on_cells + 0.5)
    between = rng.uniform(8.0, stride * (size - 3), (400, 2))
    off = decoded(between) - (between + 0.5)
    assert np.abs(off).max() <= stride / 2
    assert np.abs(off.mean(axis=0)).max() < 0.2


def test_box_has_the_aspect_of_the_input_and_a_margin() -> None:
    left, top, width, height = box_of_mask(_mask(), 0.75)
    assert (width / height, height) == (pytest.approx(0.75), pytest.approx(BOX_SCALE * 100))
    assert (left + 0.5 * width, top + 0.5 * height) == (pytest.approx(60.0), pytest.approx(80.0))


def test_crop_keeps_pixel_centres() -> None:
    image = np.zeros((40, 40, 3), np.uint8)
    image[10:20, 20:30] = 255
    crop = crop_box(image, (20.0, 10.0, 10.0, 10.0), (40, 40))
    assert crop[1:-1, 1:-1].min() > 120
    doubled = crop_box(image, (15.0, 5.0, 20.0, 20.0), (40, 40)).astype(float)[..., 0]
    rows, columns = np.indices(doubled.shape)
    assert np.average(columns + 0.5, weights=doubled) == pytest.approx(20.0, abs=0.05)
    assert np.average(rows + 0.5, weights=doubled) == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize("size", [(64, 64), ("height", "width")])
def test_mask_is_the_person(tmp_path: Path, size: tuple[int | str, int | str]) -> None:
    network = MaskNetwork(write_brightness(tmp_path / "net.onnx", size, -1.2, 20.0))
    found = network.find(_image())
    assert found.shape == (160, 120)
    assert np.mean(found == _mask()) > 0.97


def test_probabilities_logits_and_two_classes_are_told_apart() -> None:
    share = np.array([[0.0, 0.3], [0.9, 1.0]], np.float32)
    np.testing.assert_array_equal(person_share(share[None]), share)
    np.testing.assert_allclose(person_share(np.array([[[-3.0, 3.0]]], np.float32)), [[0.0474, 0.9526]], atol=1e-4)
    two = np.array([[[1.0, 0.0]], [[0.0, 2.0]]], np.float32)
    np.testing.assert_allclose(person_share(two), [[0.2689, 0.8808]], atol=1e-4)


def test_other_networks_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    with pytest.raises(AvatarError, match=r"Network .* is missing; give an ONNX file"):
        KeypointNetwork(path)
    path.write_bytes(b"no network")
    with pytest.raises(AvatarError, match="cannot be loaded"):
        MaskNetwork(path)
    with pytest.raises(AvatarError, match="must have a fixed height and width"):
        KeypointNetwork(write_brightness(path, ("height", "width"), 0.0, 1.0))
    with pytest.raises(AvatarError, match=r"gives 25 keypoints; 17 or 26 are read"):
        KeypointNetwork(write_brightest(path, (64, 48), 25, simcc=True)).find(_image(), _mask())
    with pytest.raises(AvatarError, match=r"gives \(1, 3, 64, 64\); a mask must be"):
        MaskNetwork(
            write_network(path, [helper.make_node("Identity", ["image"], ["same"])], (64, 64), ["same"], {})
        ).find(_image())
    with pytest.raises(AvatarError, match="outputs of shapes"):
        KeypointNetwork(
            write_network(path, [helper.make_node("Flatten", ["image"], ["flat"])], (64, 64), ["flat"], {})
        ).find(_image(), _mask())
    text = helper.make_tensor_value_info("out", TensorProto.STRING, None)
    arrays = helper.make_tensor_sequence_value_info("out", TensorProto.FLOAT, None)
    for node, output in (
        (helper.make_node("Cast", ["image"], ["out"], to=TensorProto.STRING), text),
        (helper.make_node("SequenceConstruct", ["image"], ["out"]), arrays),
        (helper.make_node("Slice", ["image", "zero", "zero"], ["out"]), "out"),
    ):
        write_network(path, [node], (64, 64), [output], {"zero": np.array([0])})
        with pytest.raises(AvatarError, match="must give arrays of numbers, none of them empty"):
            MaskNetwork(path).find(_image())
    with pytest.raises(AvatarError, match="not finite"):
        MaskNetwork(write_network(path, [helper.make_node("Log", ["image"], ["out"])], (64, 64), ["out"], {})).find(
            _image()
        )
