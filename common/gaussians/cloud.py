"""A set of 3-D Gaussians with colour."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import BoolArray, Float32Array


@dataclass(frozen=True, kw_only=True, eq=False)
class GaussianCloud:
    """N Gaussians in one frame, float32.

    Colour is real spherical harmonics in 3DGS order and sign: rgb = max(0, 0.5 + sum_k sh_k Y_k(direction)), with
    `direction` from the camera centre to the mean.
    """

    means_m: Float32Array
    """Centres [m], shape (N, 3)."""
    quats_wxyz: Float32Array
    """Unit quaternions that map each Gaussian's principal axes to the frame, shape (N, 4)."""
    scales_m: Float32Array
    """Standard deviations along the principal axes [m], linear, shape (N, 3)."""
    opacities: Float32Array
    """Peak opacity in 0..1, shape (N,)."""
    sh: Float32Array
    """SH coefficients, shape (N, K, 3), K = (degree + 1)^2 with degree 0..3."""

    def __post_init__(self) -> None:
        count = len(self.means_m)
        shapes = {"means_m": (count, 3), "quats_wxyz": (count, 4), "scales_m": (count, 3), "opacities": (count,)}
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != np.float32:
                raise ValueError(f"{name} must be float32 {shape}, got {array.dtype} {array.shape}.")
        if self.sh.ndim != 3 or self.sh.shape[0] != count or self.sh.shape[1] not in (1, 4, 9, 16):
            raise ValueError(f"sh must have shape ({count}, 1|4|9|16, 3), got {self.sh.shape}.")
        if self.sh.dtype != np.float32 or self.sh.shape[2] != 3:
            raise ValueError(f"sh must be float32 with 3 channels, got {self.sh.dtype} {self.sh.shape}.")

    def __len__(self) -> int:
        return len(self.means_m)

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics, 0..3."""
        return {1: 0, 4: 1, 9: 2, 16: 3}[self.sh.shape[1]]

    def select(self, index: BoolArray | npt.NDArray[np.integer]) -> "GaussianCloud":
        """Some of the Gaussians.

        Args:
            index: A mask of shape (N,), or numbers of Gaussians.
        """
        return GaussianCloud(
            means_m=self.means_m[index],
            quats_wxyz=self.quats_wxyz[index],
            scales_m=self.scales_m[index],
            opacities=self.opacities[index],
            sh=self.sh[index],
        )
