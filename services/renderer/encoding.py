"""Images as the bytes that are recorded."""

import numpy as np
import numpy.typing as npt

from readygo.common.errors import RunError
from readygo.common.images.files import encode_output
from readygo.common.images.images import Images
from readygo.common.images.names import RGB, image_name
from readygo.services.renderer.config import RendererConfig


def encode_image(rgb: npt.NDArray[np.uint8], config: RendererConfig) -> bytes:
    """An sRGB image, shape (H, W, 3), as a JPEG or PNG file."""
    import cv2

    bgr = np.ascontiguousarray(rgb[..., ::-1])
    if config.image_format == "jpeg":
        done, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, config.jpeg_quality])
    else:
        done, encoded = cv2.imencode(".png", bgr)
    assert done
    return bytes(encoded)


def encode_outputs(images: Images, config: RendererConfig, camera: str = "") -> dict[str, bytes]:
    """The images of a view besides rgb that the config asks for, by name, as `readygo.common.images.files` says.

    Args:
        images: The view's.
        config: Which are recorded.
        camera: Whose view it is; of cameras besides the first one the rgb is among them.

    Raises:
        RunError: If the view lacks one of them.
    """
    try:
        files = {image_name(camera, name): encode_output(images, name) for name in config.outputs if name != RGB}
    except ValueError as error:
        raise RunError(f"The {config.backend} backend cannot do that: {error}") from error
    return {image_name(camera, RGB): encode_image(images.rgb, config), **files} if camera else files
