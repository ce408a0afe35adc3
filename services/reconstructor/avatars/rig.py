"""The skeleton of a person who is filmed: stature, lengths of bones, and the pose of every frame; all of it learned.

Legend: t, c = a joint in the T-pose and in the canonical pose of the first body, p = its parent; s = stature relative
to it; k_j = how much longer the bone from p to j is, and o_j = how far its end is from there, the same left and right;
R_p = rotation of p from the canonical pose to the T-pose.

    t'_j = t'_p + s (k_j (t_j - t_p) + o_j),   c'_j = c'_p + s (k_j (c_j - c_p) + R_p^T o_j)
    B_j x = c'_j + s (I + (k_m - 1) u u^T)(x - c_j)

with u the direction of the bone that begins at j and k_m its length: what hangs on a bone is stretched along with it.
Offsets move centres of rotation, which silhouettes hardly show, but motions do.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars import SMPL_PARENTS, Avatar, joint_positions
from readygo.common.avatars.torch_posing import (
    Skeletons,
    joint_transforms,
    load_skeletons,
    nearest_quat,
    rotation_matrices,
)
from readygo.common.messages import Motion
from readygo.services.reconstructor.avatars.config import PosePriorConfig

Tensor = torch.Tensor
BONES = (
    (3,), (6,), (9,), (12,), (15,), (13, 14), (16, 17), (18, 19), (20, 21), (22, 23), (1, 2), (4, 5), (7, 8), (10, 11),
)  # fmt: skip
"""Joints at the ends of the bones that have a common length."""
BONE_OF_JOINT = np.array([next((k for k, ends in enumerate(BONES) if joint in ends), 0) for joint in range(24)])
"""Row of `BONES` of the bone that ends at each joint, shape (24,); 0 for the pelvis."""
_MAIN_CHILD = {
    0: 3, 1: 4, 2: 5, 3: 6, 4: 7, 5: 8, 6: 9, 7: 10, 8: 11, 9: 12, 12: 15, 13: 16, 14: 17, 16: 18, 17: 19, 18: 20,
    19: 21, 20: 22, 21: 23,
}  # fmt: skip
BONE_SIGMA, SIZE_SIGMA, _OFFSET_SIGMA_M = 0.08, 0.3, 0.02
"""Standard deviations among people: of the logarithms of the lengths of bones and of stature, and of offsets."""
_SHARED = ("size", "bones", "offsets")
"""What all frames have in common."""
_BETA1, _BETA2 = 0.9, 0.99


@dataclass(eq=False)
class PosedSkeleton:
    """Transforms of one frame, differentiable."""

    A: Tensor
    """To the world, float64, shape (24, 3, 4)."""
    B: Tensor
    """To the shaped body, float64, shape (24, 3, 4)."""

    def arrays(self) -> tuple[Float32Array, Float32Array, Float32Array]:
        """A, B, and the quaternions of A, float32."""
        with torch.no_grad():
            quats = nearest_quat(self.A[:, :, :3])
        return tuple(part.detach().float().numpy() for part in (self.A, self.B, quats))  # type: ignore[return-value]


class Rig:
    """Skeleton and poses in training; the state of its optimiser lies with them."""

    def __init__(self, body: Avatar, pose: Float64Array, root_m: Float64Array, prior: PosePriorConfig) -> None:
        """Begin with the body's own lengths.

        Args:
            body: The first body.
            pose: Given poses, shape (F, 24, 3).
            root_m: Given pelvises [m], shape (F, 3).
            prior: How far both are trusted.
        """
        self._prior, self._body = prior, body.skeleton()
        self._skeletons = load_skeletons([body], "cpu")
        self._parents = torch.tensor(np.maximum(SMPL_PARENTS, 0).astype(np.int64))
        self._given = rotation_matrices(torch.tensor(pose)), torch.tensor(root_m)
        self.values = {
            "size": np.zeros(1),
            "bones": np.zeros(len(BONES)),
            "offsets": np.zeros((len(BONES), 3)),
            "pose": pose.copy(),
            "root": root_m.copy(),
        }
        self.first = {name: np.zeros_like(value) for name, value in self.values.items()}
        self.second = {name: np.zeros_like(value) for name, value in self.values.items()}
        self.updates = np.zeros(1 + len(pose))
        """How often the lengths, and each frame, were changed."""
        group, mirror = BONE_OF_JOINT, np.ones((24, 3))
        for joints in BONES:
            if len(joints) == 2:
                mirror[joints[1], 0] = -1.0
            else:
                mirror[joints[0], 0] = 0.0
        mirror[0] = 0.0
        self._group, self._mirror = torch.tensor(group), torch.tensor(mirror)
        self._axes, self._stretched = _bone_axes(body.joints_canonical_m.astype(np.float64), group)
        self._leaves: dict[str, Tensor] = {}

    def state(self) -> dict[str, Float64Array]:
        """All arrays by name, for a checkpoint."""
        parts = {"rig": self.values, "rig1": self.first, "rig2": self.second}
        return {f"{part}_{name}": array for part, arrays in parts.items() for name, array in arrays.items()} | {
            "rig_updates": self.updates
        }

    def load(self, state: dict[str, Float64Array]) -> None:
        """The inverse of `state`."""
        for part, arrays in (("rig", self.values), ("rig1", self.first), ("rig2", self.second)):
            for name in arrays:
                arrays[name] = state[f"{part}_{name}"]
        self.updates = state["rig_updates"]

    def pose(self, frame: int) -> PosedSkeleton:
        """The transforms of a frame; `step` then takes derivatives by them."""
        rows = {name: value if name in _SHARED else value[frame] for name, value in self.values.items()}
        leaves = {name: torch.tensor(row, requires_grad=True) for name, row in rows.items()}
        self._leaves = leaves
        skeleton, B = self._shaped(leaves)
        only = torch.zeros(1, dtype=torch.int64)
        A = joint_transforms(skeleton, only, leaves["root"][None], leaves["pose"][None])[0]
        return PosedSkeleton(A=A, B=B)

    def step(
        self,
        frame: int,
        posed: PosedSkeleton,
        by_A: Float32Array,
        by_B: Float32Array,
        rates: dict[str, float],
    ) -> None:
        """Change lengths and one frame's pose by the derivatives of a loss by the frame's transforms.

        Args:
            frame: Which frame.
            posed: What `pose` gave.
            by_A: Derivatives, shape (24, 3, 4).
            by_B: Shape (24, 3, 4).
            rates: Learning rates by name; what has none stays.
        """
        leaves = self._leaves
        loss = self._prior_loss(frame, leaves)
        torch.autograd.backward(  # type: ignore[no-untyped-call]
            [posed.A, posed.B, loss], [torch.from_numpy(by_A).double(), torch.from_numpy(by_B).double(), None]
        )
        self.updates[0] += 1
        self.updates[1 + frame] += 1
        for name, rate in rates.items():
            whole = name in _SHARED
            gradient = leaves[name].grad
            assert gradient is not None
            index: slice | int = slice(None) if whole else frame
            count = self.updates[0 if whole else 1 + frame]
            first, second = self.first[name], self.second[name]
            g = gradient.numpy()
            first[index] = _BETA1 * first[index] + (1.0 - _BETA1) * g
            second[index] = _BETA2 * second[index] + (1.0 - _BETA2) * g * g
            moved = first[index] / (1.0 - _BETA1**count)
            self.values[name][index] -= rate * moved / (np.sqrt(second[index] / (1.0 - _BETA2**count)) + 1e-12)

    def shaped_joints(self) -> tuple[Float64Array, Float64Array, Float32Array]:
        """Joints in the T-pose and in the canonical pose of the shaped body [m], (24, 3) each, and B (24, 3, 4)."""
        with torch.no_grad():
            skeleton, B = self._shaped({name: torch.tensor(self.values[name]) for name in _SHARED})
        return skeleton.tpose_m[0].numpy(), skeleton.canonical_m[0].numpy(), B.float().numpy()

    def joints(self) -> Float64Array:
        """Where the joints are in all frames, in the film's world [m], shape (F, 24, 3)."""
        tpose = self.shaped_joints()[0].astype(np.float32)
        motion = Motion(
            root_m=self.values["root"].astype(np.float32), pose_axis_angle=self.values["pose"].astype(np.float32)
        )
        return joint_positions(dataclasses.replace(self._body, joints_tpose_m=tpose), motion)

    @property
    def size(self) -> float:
        """Stature relative to the first body."""
        return float(np.exp(self.values["size"][0]))

    def _shaped(self, lengths: dict[str, Tensor]) -> tuple[Skeletons, Tensor]:
        s, bones = torch.exp(lengths["size"][0]), lengths["bones"]
        along, offsets = torch.exp(bones)[self._group], lengths["offsets"][self._group] * self._mirror
        R_canonical_tpose = self._skeletons.R_tpose_canonical[0].mT
        joints = [
            stretch_joints(self._skeletons.tpose_m[0], s, along, offsets),
            stretch_joints(
                self._skeletons.canonical_m[0],
                s,
                along,
                (R_canonical_tpose[self._parents] @ offsets[..., None])[..., 0],
            ),
        ]
        skeleton = Skeletons(
            tpose_m=joints[0][None],
            canonical_m=joints[1][None],
            R_tpose_canonical=self._skeletons.R_tpose_canonical,
            parents=self._skeletons.parents,
        )
        along = torch.where(self._stretched >= 0, torch.exp(bones)[self._stretched.clamp(min=0)], 1.0)
        u = self._axes
        L = s * (torch.eye(3, dtype=torch.float64) + (along - 1.0)[:, None, None] * u[:, :, None] * u[:, None, :])
        shift = joints[1] - (L @ self._skeletons.canonical_m[0][..., None])[..., 0]
        return skeleton, torch.cat([L, shift[..., None]], dim=2)

    def _prior_loss(self, frame: int, leaves: dict[str, Tensor]) -> Tensor:
        """How unlikely the frame's pose and the lengths are."""
        prior = self._prior
        R, root = rotation_matrices(leaves["pose"]), leaves["root"]
        joint_rad, jerk_rad = np.deg2rad(prior.joint_deg), np.deg2rad(prior.jerk_deg)
        # The squared Frobenius norm of a difference of rotations is twice the squared angle.
        loss = ((R - self._given[0][frame]) ** 2).sum() / (144.0 * joint_rad**2)
        loss = loss + ((root - self._given[1][frame]) ** 2).mean() / prior.root_m**2
        count = len(self.values["root"])
        if 0 < frame < count - 1:
            pose, roots = self.values["pose"], self.values["root"]
            middle = rotation_matrices(torch.from_numpy(pose[[frame - 1, frame + 1]])).mean(dim=0)
            loss = loss + ((R - middle) ** 2).sum() / (144.0 * jerk_rad**2)
            between = torch.from_numpy(0.5 * (roots[frame - 1] + roots[frame + 1]))
            loss = loss + ((root - between) ** 2).mean() / prior.jerk_m**2
        lengths = (leaves["bones"] ** 2).mean() / BONE_SIGMA**2 + (leaves["size"][0] / SIZE_SIGMA) ** 2
        lengths = lengths + (leaves["offsets"] ** 2).mean() / _OFFSET_SIGMA_M**2
        total: Tensor = prior.weight * (loss + 0.1 * lengths)
        return total


def stretch_joints(joints: Tensor, size: Tensor, lengths: Tensor, offsets: Tensor) -> Tensor:
    """Joints of a body of another stature and other bones, shape (24, 3)."""
    parents = SMPL_PARENTS.tolist()
    places = [size * joints[0]]
    for joint in range(1, 24):
        bone = lengths[joint] * (joints[joint] - joints[parents[joint]]) + offsets[joint]
        places.append(places[parents[joint]] + size * bone)
    return torch.stack(places)


def _bone_axes(joints: Float64Array, group: "np.ndarray[tuple[int, ...], np.dtype[np.int64]]") -> tuple[Tensor, Tensor]:
    """Unit vectors along the bones that begin at the joints (24, 3), and the group of each bone; -1 without one."""
    axes, stretched = np.zeros((24, 3)), np.full(24, -1, dtype=np.int64)
    for joint, child in _MAIN_CHILD.items():
        bone = joints[child] - joints[joint]
        axes[joint] = bone / max(float(np.linalg.norm(bone)), 1e-9)
        stretched[joint] = group[child]
    return torch.tensor(axes), torch.tensor(stretched)
