import cv2
import numpy as np
import pytest

from readygo.common.errors import RunError
from readygo.common.images.files import decode_output
from readygo.common.images.images import Images
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.encoding import encode_image, encode_outputs

RAMP = np.stack([*np.meshgrid(np.arange(0, 256, 8), np.arange(0, 256, 16)), np.full((16, 32), 40)], axis=-1)
RGB = RAMP.astype(np.uint8)


def decoded(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def test_png_is_the_image_with_red_first() -> None:
    data = encode_image(RGB, RendererConfig(image_format="png"))
    assert data.startswith(b"\x89PNG")
    assert np.array_equal(decoded(data), RGB)


def test_jpeg_is_near_the_image_and_nearer_and_larger_with_more_quality() -> None:
    low, high = (encode_image(RGB, RendererConfig(jpeg_quality=quality)) for quality in (20, 95))
    assert high.startswith(b"\xff\xd8")
    errors = [np.abs(decoded(data).astype(int) - RGB).mean() for data in (low, high)]
    assert errors[1] < errors[0]
    assert errors[1] < 6
    assert len(low) < len(high)


def test_outputs_are_those_of_the_config_besides_rgb() -> None:
    depth_m = np.full((1, 4, 5), 2.5, np.float32)
    images = Images(rgb=np.zeros((1, 4, 5, 3), np.uint8), depth_m=depth_m, mask=np.ones((1, 4, 5), np.uint8))[0]
    assert encode_outputs(images, RendererConfig()) == {}
    files = encode_outputs(images, RendererConfig(outputs=("rgb", "depth")))
    assert list(files) == ["depth"]
    assert np.array_equal(decode_output("depth", files["depth"]), depth_m[0])


def test_output_that_was_not_drawn_is_refused_with_the_backends_name() -> None:
    images = Images(rgb=np.zeros((1, 4, 5, 3), np.uint8))[0]
    with pytest.raises(RunError, match=r"^The reference backend cannot do that: .*normal"):
        encode_outputs(images, RendererConfig(backend="reference", outputs=("rgb", "normal")))
