"""The avatar: animatable Gaussians bound to a SMPL-24 skeleton."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.messages.checks import check_array

SMPL_PARENTS = np.array(
    [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21], dtype=np.int32
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Avatar:
    """A human in a canonical pose, SMPL axes (y up, +x the body's left, +z facing, soles at y = 0)."""

    name: str
    """What the human is called in scenarios and shards."""
    license: str
    """Terms under which the human may be used."""
    height_m: float
    """Height from the soles to the top of the head [m]."""
    cloud: GaussianCloud
    """Gaussians in the canonical pose [m], SMPL axes."""
    lbs_index: UInt8Array
    """Joints that move each Gaussian, shape (N, 4)."""
    lbs_weight: Float32Array
    """Their weights, rows sum to 1, shape (N, 4)."""
    joints_canonical_m: Float32Array
    """Joints in the canonical pose [m], shape (24, 3)."""
    joints_tpose_m: Float32Array
    """Joints in SMPL's T-pose [m], shape (24, 3): forward kinematics starts here."""
    R_tpose_canonical: Float32Array
    """Rotation of each joint from the canonical pose to the T-pose, shape (24, 3, 3)
    (the file's `R_canonical_to_tpose`)."""

    def skeleton(self) -> "Avatar":
        """The avatar without its Gaussians, for those who have them packed: some kilobytes."""
        nobody = np.zeros(0, dtype=np.int64)
        return dataclasses.replace(
            self,
            cloud=self.cloud.select(nobody),
            lbs_index=self.lbs_index[nobody],
            lbs_weight=self.lbs_weight[nobody],
        )

    def __post_init__(self) -> None:
        count = len(self.cloud)
        check_array("lbs_index", self.lbs_index, np.uint8, (count, 4))
        check_array("lbs_weight", self.lbs_weight, np.float32, (count, 4))
        for name in ("joints_canonical_m", "joints_tpose_m"):
            check_array(name, getattr(self, name), np.float32, (24, 3))
        check_array("R_tpose_canonical", self.R_tpose_canonical, np.float32, (24, 3, 3))
