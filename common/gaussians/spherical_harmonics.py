"""Real spherical harmonics in 3DGS order and sign, degrees 0 to 3, and their rotation."""

from functools import cache

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

_C1 = 0.4886025119029199
_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
_C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)


def sh_basis(directions: npt.ArrayLike, degree: int) -> Floats:
    """Basis functions of all degrees up to `degree`.

    Args:
        directions: Unit vectors, shape (N, 3).
        degree: 0..3.

    Returns:
        Values, shape (N, (degree + 1)^2).
    """
    x, y, z = np.asarray(directions, dtype=np.float64).T
    xx, yy, zz = x * x, y * y, z * z
    values = [
        np.full_like(x, 0.28209479177387814),
        -_C1 * y,
        _C1 * z,
        -_C1 * x,
        _C2[0] * x * y,
        _C2[1] * y * z,
        _C2[2] * (2 * zz - xx - yy),
        _C2[3] * x * z,
        _C2[4] * (xx - yy),
        _C3[0] * y * (3 * xx - yy),
        _C3[1] * x * y * z,
        _C3[2] * y * (4 * zz - xx - yy),
        _C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
        _C3[4] * x * (4 * zz - xx - yy),
        _C3[5] * z * (xx - yy),
        _C3[6] * x * (xx - 3 * yy),
    ]
    return np.stack(values[: (degree + 1) ** 2], axis=1)


@cache
def _sample_directions() -> Floats:
    """64 unit vectors on a Fibonacci spiral: enough to determine every degree with a small condition number."""
    k = np.arange(64) + 0.5
    z = 1 - 2 * k / 64
    angle = np.pi * (1 + np.sqrt(5)) * k
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def rotate_sh(sh: npt.NDArray[np.float32], R: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Coefficients of colours that are rotated with their Gaussians: seen along R d, the colour is the old one along d.

    Each degree is a representation of its own: its matrix follows from the basis at a fixed set of directions.

    Args:
        sh: Coefficients, shape (N, K, 3), K = 1, 4, 9 or 16.
        R: Rotation, shape (3, 3).

    Returns:
        Rotated coefficients, shape (N, K, 3).
    """
    degree = round(np.sqrt(sh.shape[1])) - 1
    directions = _sample_directions()
    old = sh_basis(directions, degree)
    new = sh_basis(directions @ np.asarray(R, dtype=np.float64).T, degree)
    out = sh.copy()
    for band in range(1, degree + 1):
        rows = slice(band * band, (band + 1) ** 2)
        # new[:, rows] @ D = old[:, rows]: values at R d of the rotated colour equal those at d of the given one.
        D = np.linalg.lstsq(new[:, rows], old[:, rows], rcond=None)[0]
        out[:, rows] = np.einsum("jk,nkc->njc", D, sh[:, rows].astype(np.float64))
    return out
