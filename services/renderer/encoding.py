"""Images as the bytes that are recorded."""

import numpy as np
import numpy.typing as npt

from services.renderer.config import RendererConfig


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
