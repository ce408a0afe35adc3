"""How much a picture shows: its sharpness, and the share of it that is surface.

Fog is what a camera sees that stands inside of large Gaussians, or looks at ground that was not filmed. Both numbers
are low there; they were measured from a robot's height (camera 144x256, 100 deg, 0.5 m above the floor), at the places
and in the directions in which an expert drove (sharpness, as recorded), or at 80 random ones (coverage):

    scene                                    sharpness of an episode      coverage of a view
                                             (median of its pictures)     median    5 % .. 95 %
    furnished flat, filmed (show)            660..2000                    87 %      62..94 %
    embedded flat (emb)                      360..740                     96 %      81..100 %
    the same with noise, lens and shutter    270..500 (emb), 530..920 (show)
    camp site filmed from above, in fog      4..190                       31 %       5..56 %
    flower bed without anything around it    450 (views)                  20 %       0..58 %

Single pictures of good scenes may be as dull as fog (a wall, the side of a sofa): limits are for medians.
"""

import math

import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.images.images import Images

SHARP_FROM = 150.0
"""Sharpness of the median picture of an episode, or of the views from a place, from which on it is taken for clear: all
episodes of the good scenes above, and one of eight in the fog."""
COVERED_FROM = 0.45
"""Coverage of the median view from which on there is enough to see: an open place without a sky fills the half below
the horizon."""
CLARITY_OUTPUTS = ("rgb", "depth", "median_depth", "alpha")
"""What `coverage` looks at, and the picture."""
_PIXELS = 72 * 128
_OPAQUE = 0.5
_DEPTH_SPREAD = 0.25


def sharpness(rgb: UInt8Array) -> float:
    """Variance of the Laplacian of a picture's grey values [grey levels squared]; 0 in a picture of one colour.

    Pictures of more than 9,216 pixels (72x128) are averaged down to that many first, so that the same view gives the
    same number at any size: 429, 434, 393 and 374 at 72, 144, 288 and 576 rows (median of 40 views, embedded flat).
    Smaller pictures are taken as they are.

    Args:
        rgb: sRGB picture, shape (H, W, 3), at least 3x3.

    Source: Pech-Pacheco et al., Diatom autofocusing in brightfield microscopy, ICPR 2000.
    """
    import cv2

    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    factor = math.sqrt(grey.size / _PIXELS)
    if factor > 1.0:
        height, width = (max(3, round(side / factor)) for side in grey.shape)
        grey = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    # Whole numbers: the sums are exact in any order of addition.
    g = grey.astype(np.int64)
    laplacian = g[:-2, 1:-1] + g[2:, 1:-1] + g[1:-1, :-2] + g[1:-1, 2:] - 4 * g[1:-1, 1:-1]
    count, total, squares = laplacian.size, int(laplacian.sum()), int((laplacian * laplacian).sum())
    return (squares * count - total * total) / (count * count)


def coverage(images: Images) -> float:
    """Share of a view's pixels that show a surface, 0..1.

    Light of a surface comes from one depth: where the mean depth and the depth of the median Gaussian differ by more
    than a quarter of the smaller one, there is haze; where less than half of the light is blocked, there is nothing.

    Args:
        images: One view with `CLARITY_OUTPUTS`.
    """
    assert images.depth_m is not None
    assert images.median_depth_m is not None
    assert images.alpha is not None
    mean_m, median_m = images.depth_m.astype(np.float64), images.median_depth_m.astype(np.float64)
    opaque = (images.alpha >= _OPAQUE) & np.isfinite(mean_m) & np.isfinite(median_m)
    mean_m, median_m = mean_m[opaque], median_m[opaque]
    surface = np.abs(mean_m - median_m) <= _DEPTH_SPREAD * np.minimum(mean_m, median_m)
    return int(np.count_nonzero(surface)) / images.alpha.size
