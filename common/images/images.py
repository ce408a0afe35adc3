"""What a rasterizer can make of views."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, UInt8Array

FIELDS: Mapping[str, str] = {
    "rgb": "rgb",
    "depth": "depth_m",
    "median_depth": "median_depth_m",
    "alpha": "alpha",
    "mask": "mask",
    "normal": "normal",
}
"""Name of an image that can be asked for -> its field in `Images`."""
OUTPUTS = tuple(FIELDS)
"""Names of the images that can be asked for."""


def require_outputs(outputs: Sequence[str]) -> frozenset[str]:
    """The names as a set.

    Raises:
        ValueError: If a name is not one of `OUTPUTS`.
    """
    unknown = sorted({name for name in outputs if name not in OUTPUTS})
    if isinstance(outputs, str) or unknown:
        raise ValueError(f"outputs must be names out of {', '.join(OUTPUTS)}; got {outputs!r}.")
    return frozenset(outputs)


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
    """The images of one view, or of V views with V as their first axis; those that were not asked for are None.

    A pixel's median Gaussian is the one that brings its transmittance below one half.
    """

    rgb: UInt8Array
    """sRGB for scenes trained on sRGB images, shape (H, W, 3)."""
    depth_m: Float32Array | None = None
    """Mean depth along the optical axis, weighted as colours are [m]; inf where nothing is drawn, shape (H, W)."""
    median_depth_m: Float32Array | None = None
    """Depth of the median Gaussian [m]; inf where there is none, shape (H, W)."""
    alpha: Float32Array | None = None
    """One minus the transmittance that is left, shape (H, W)."""
    mask: UInt8Array | None = None
    """Whose the median Gaussian is: k for the k-th human that was asked for, counted from 1; 0 for the scene and
    where there is none, shape (H, W)."""
    normal: Float32Array | None = None
    """Mean of the Gaussians' shortest axes that look towards the camera, weighted as colours are, of length 1, in the
    camera's frame; 0 where nothing is drawn, shape (H, W, 3)."""

    def __getitem__(self, view: int) -> "Images":
        """The images of one of V views."""
        return Images(**{name: array[view] for name, array in self.arrays().items()})

    def arrays(self) -> dict[str, AnyArray]:
        """The images that are there, by field."""
        return {name: getattr(self, name) for name in FIELDS.values() if getattr(self, name) is not None}


def empty_images(views: int, height_px: int, width_px: int, wanted: frozenset[str]) -> Images:
    """Memory for the wanted images of V views, rgb among them."""
    arrays = {}
    for name in wanted | {"rgb"}:
        channels = (3,) if name in ("rgb", "normal") else ()
        dtype = np.uint8 if name in ("rgb", "mask") else np.float32
        arrays[FIELDS[name]] = np.empty((views, height_px, width_px, *channels), dtype=dtype)
    return Images(**arrays)
