"""The skeleton of a person who is filmed: stature, lengths of bones, and the pose of every frame; all of it learned.

What images do not show stays as it is among people: lengths begin as the mean of known bodies, not as the first body's.

Legend: t, c = a joint in the T-pose and in the canonical pose of the first body, p = its parent; s = stature relative
to it; k_j = how much longer the bone from p to j is, and o_j = how far its end is from there, the same left and right;
R_p = rotation of p from the canonical pose to the T-pose.

    t'_j = t'_p + s (k_j (t_j - t_p) + o_j),   c'_j = c'_p + s (k_j (c_j - c_p) + R_p^T o_j)
    B_j x = c'_j + s (I + (k_m - 1) u u^T)(x - c_j)

with u the direction of the bone that begins at j and k_m its length: what hangs on a bone is stretched along with it.
Offsets move centres of rotation, which silhouettes hardly show, but motions do.

Poses are learned as the modes of a `PoseTrajectory`, in units of their standard deviations: every frame tells something
of all of them, and the motion stays as smooth as the given one. With its modes u_m, their deviations d and what is
learned, z, and with R0 and p0 of the likeliest motion,

    R_j(f) = exp(sum_m d_jm u_m(f) z_jm) R0_j(f),   p(f) = p0(f) + sum_m d_m u_m(f) z_m
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars import SMPL_PARENTS, Avatar, joint_positions
from readygo.common.avatars.torch_posing import (
    Skeletons,
    load_skeletons,
    nearest_quat,
    rotation_matrices,
    turned_joints,
)
from readygo.common.frames import axis_angle_from_matrix
from readygo.common.messages import Motion
from readygo.services.reconstructor.avatars.contacts import (
    LEVEL_FLOOR,
    SOLE_JOINTS,
    Floor,
    carry,
    find_contacts,
    find_floor,
    lift_cost,
    settle_floor,
    slip_cost,
    sole_offsets,
    standing_share,
)
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory

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
_LENGTHS = ("size", "bones", "offsets")
_LENGTHS_WEIGHT = 4e-3
"""Weight in the loss of the mean squared deviation of lengths: what no image shows stays as it is on the body."""
_POSE_ROW = 3
"""Row of poses in the counts of updates."""
_BALL_SHARE = 0.018
"""Height of the joints of the balls of the feet over the soles, as a share of stature: 3 cm of 1.7 m."""
_BETA1, _BETA2 = 0.9, 0.99
_MIRROR = np.ones((24, 3))
"""What makes bones of the right side those of the left, and of the middle such as have no side, shape (24, 3)."""
for _ends in BONES:
    _MIRROR[_ends[-1], 0] = -1.0 if len(_ends) == 2 else 0.0
_MIRROR[0] = 0.0


@dataclass(frozen=True, eq=False)
class BoneLengths:
    """Lengths of a skeleton relative to a body of the same stature, the same left and right."""

    bones: Float64Array
    """Logarithms of how much longer bones are, by the rows of `BONES`, shape (14,)."""
    offsets_m: Float64Array
    """How far their ends are from there in the T-pose, those of left joints, shape (14, 3)."""

    @classmethod
    def of_body(cls) -> "BoneLengths":
        """Those of the body itself."""
        return cls(np.zeros(len(BONES)), np.zeros((len(BONES), 3)))


def mean_lengths(body: Avatar, bodies: Sequence[Avatar], weights: Float64Array) -> BoneLengths:
    """The mean skeleton of bodies, each in the size of `body`, relative to that of `body`.

    Args:
        body: The first body.
        bodies: B bodies.
        weights: How much each counts, shape (B,); their sum is 1.
    """
    parents = np.maximum(SMPL_PARENTS, 0)

    def bones_of(other: Avatar) -> Float64Array:
        joints = other.joints_tpose_m.astype(np.float64)
        return (joints - joints[parents]) * (body.height_m / other.height_m)

    own, mean = bones_of(body), np.einsum("b,bjc->jc", weights, [bones_of(other) for other in bodies])
    lengths = BoneLengths.of_body()
    for row, joints in enumerate(BONES):
        left = _MIRROR[list(joints)]
        first, usual = ((left * part[list(joints)]).mean(axis=0) for part in (own, mean))
        factor = float(usual @ first / (first @ first))
        lengths.bones[row], lengths.offsets_m[row] = np.log(factor), usual - factor * first
    return lengths


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

    def __init__(
        self,
        body: Avatar,
        trajectory: PoseTrajectory,
        prior_weight: float,
        likely: BoneLengths | None = None,
        *,
        contact_weight: float = 0.0,
        contacts_every: int = 1,
    ) -> None:
        """Begin with the likeliest lengths and motion.

        Args:
            body: The first body.
            trajectory: How the person moved.
            prior_weight: Weight in the loss of how unlikely the motion is.
            likely: The likeliest lengths; None takes the body's.
            contact_weight: Weight in the loss of how unlikely it is that soles which stand float or slip, in a frame; 0
                where frames do not follow each other in time.
            contacts_every: After so many updates it is found (again) which soles stand; none do before.
        """
        likely = BoneLengths.of_body() if likely is None else likely
        self._likely_bones, self._likely_offsets = torch.tensor(likely.bones), torch.tensor(likely.offsets_m)
        self._weight, self._body = prior_weight, body.skeleton()
        self._skeletons = load_skeletons([body], "cpu")
        self._parents = torch.tensor(np.maximum(SMPL_PARENTS, 0).astype(np.int64))
        self._R0, self._root0_m = rotation_matrices(torch.tensor(trajectory.pose_axis_angle)), trajectory.root_m
        self._modes, self._joint_rad, self._modes_m = (
            torch.from_numpy(part) for part in (trajectory.modes, trajectory.joint_rad, trajectory.modes_m)
        )
        self.values = {
            "size": np.zeros(1),
            "bones": np.zeros(len(BONES)),
            "offsets": np.zeros((len(BONES), 3)),
            "pose": np.zeros_like(trajectory.pose_axis_angle),
            "root": np.zeros_like(trajectory.root_m),
        }
        self.first = {name: np.zeros_like(value) for name, value in self.values.items()}
        self.second = {name: np.zeros_like(value) for name, value in self.values.items()}
        self.updates = np.zeros(len(self.values))
        """How often each of the values was changed."""
        self._group, self._mirror = torch.tensor(BONE_OF_JOINT), torch.tensor(_MIRROR)
        self._axes, self._stretched = _bone_axes(body.joints_canonical_m.astype(np.float64), BONE_OF_JOINT)
        self._leaves: dict[str, Tensor] = {}
        self._contact_weight, self._contacts_every = contact_weight, contacts_every
        tpose = body.joints_tpose_m.astype(np.float64)
        ball_m = _BALL_SHARE * body.height_m
        self._soles_m = sole_offsets(tpose, float(tpose[SOLE_JOINTS, 1].min()) - ball_m)
        self._contacts = torch.zeros(len(self._R0) - 1, len(SOLE_JOINTS), dtype=torch.float64)
        self._floor = LEVEL_FLOOR
        self._floating = torch.zeros(())

    def state(self) -> dict[str, Float64Array]:
        """All arrays by name, for a checkpoint."""
        parts = {"rig": self.values, "rig1": self.first, "rig2": self.second}
        return {f"{part}_{name}": array for part, arrays in parts.items() for name, array in arrays.items()} | {
            "rig_updates": self.updates,
            "rig_contacts": self._contacts.numpy(),
            "rig_floor": np.concatenate([self._floor.up, self._floor.heights_m]),
        }

    def load(self, state: dict[str, Float64Array]) -> None:
        """The inverse of `state`."""
        for part, arrays in (("rig", self.values), ("rig1", self.first), ("rig2", self.second)):
            for name in arrays:
                arrays[name] = state[f"{part}_{name}"]
        self.updates = state["rig_updates"]
        self._contacts = torch.from_numpy(state["rig_contacts"])
        self._floor = Floor(up=state["rig_floor"][:3], heights_m=state["rig_floor"][3:])

    def pose(self, frame: int) -> PosedSkeleton:
        """The transforms of a frame; `step` then takes derivatives by them."""
        updates = self.updates[_POSE_ROW]
        if self._contact_weight > 0.0 and updates > 0 and updates % self._contacts_every == 0:
            self._find_contacts()
        leaves = {name: torch.tensor(value, requires_grad=True) for name, value in self.values.items()}
        self._leaves = leaves
        skeleton, B = self._shaped(leaves)
        A = self._transforms(leaves, skeleton, [frame])[0]
        if self._contact_weight > 0.0:
            self._floating = self._contact_cost(leaves, frame)
        return PosedSkeleton(A=A, B=B)

    def step(
        self,
        posed: PosedSkeleton,
        by_A: Float32Array,
        by_B: Float32Array,
        rates: dict[str, float],
    ) -> None:
        """Change lengths and motion by the derivatives of a loss by a frame's transforms.

        Args:
            posed: What `pose` gave.
            by_A: Derivatives, shape (24, 3, 4).
            by_B: Shape (24, 3, 4).
            rates: Learning rates by name; what has none stays.
        """
        leaves = self._leaves
        loss = self._prior_loss(leaves) + self._contact_weight * self._floating
        torch.autograd.backward(  # type: ignore[no-untyped-call]
            [posed.A, posed.B, loss], [torch.from_numpy(by_A).double(), torch.from_numpy(by_B).double(), None]
        )
        for row, name in enumerate(self.values):
            if name not in rates:
                continue
            self.updates[row] += 1
            gradient, count = leaves[name].grad, self.updates[row]
            assert gradient is not None
            first, second, g = self.first[name], self.second[name], gradient.numpy()
            first[:] = _BETA1 * first + (1.0 - _BETA1) * g
            second[:] = _BETA2 * second + (1.0 - _BETA2) * g * g
            moved = first / (1.0 - _BETA1**count)
            self.values[name] -= rates[name] * moved / (np.sqrt(second / (1.0 - _BETA2**count)) + 1e-12)

    def shaped_joints(self) -> tuple[Float64Array, Float64Array, Float32Array]:
        """Joints in the T-pose and in the canonical pose of the shaped body [m], (24, 3) each, and B (24, 3, 4)."""
        with torch.no_grad():
            skeleton, B = self._shaped({name: torch.tensor(self.values[name]) for name in _LENGTHS})
        return skeleton.tpose_m[0].numpy(), skeleton.canonical_m[0].numpy(), B.float().numpy()

    def joints(self) -> Float64Array:
        """Where the joints are in all frames, in the film's world [m], shape (F, 24, 3)."""
        tpose, (pose, root_m) = self.shaped_joints()[0].astype(np.float32), self.poses()
        motion = Motion(root_m=root_m.astype(np.float32), pose_axis_angle=pose.astype(np.float32))
        return joint_positions(dataclasses.replace(self._body, joints_tpose_m=tpose), motion)

    def poses(self) -> tuple[Float64Array, Float64Array]:
        """Rotations of the joints [rad], shape (F, 24, 3), and pelvises [m], shape (F, 3), as they are found."""
        values = {name: torch.from_numpy(self.values[name]) for name in ("pose", "root")}
        R, root_m = self._moved(values, list(range(len(self._R0))))
        return axis_angle_from_matrix(R.numpy()), root_m.numpy()

    @property
    def size(self) -> float:
        """Stature relative to the first body."""
        return float(np.exp(self.values["size"][0]))

    def _moved(self, values: dict[str, Tensor], frames: list[int]) -> tuple[Tensor, Tensor]:
        """Rotations of the joints of n frames, shape (n, 24, 3, 3), and their pelvises [m], shape (n, 3)."""
        rows = self._modes[frames]
        turns = torch.einsum("jm,nm,mjc->njc", self._joint_rad, rows, values["pose"])
        root_m = torch.from_numpy(self._root0_m[frames]) + (self._modes_m * rows) @ values["root"]
        return rotation_matrices(turns) @ self._R0[frames], root_m

    def _transforms(self, values: dict[str, Tensor], skeleton: Skeletons, frames: list[int]) -> Tensor:
        """Transforms of the joints to the world in n frames, shape (n, 24, 3, 4)."""
        R, root_m = self._moved(values, frames)
        return turned_joints(skeleton, torch.zeros(len(frames), dtype=torch.int64), root_m, R)

    def _contact_cost(self, values: dict[str, Tensor], frame: int) -> Tensor:
        """How unlikely the soles of a frame are; moves from and to its neighbours count half, as these are drawn too.

        Lengths have no part in it: shorter legs would slip less.
        """
        near = list(range(max(frame - 1, 0), min(frame + 2, len(self._R0))))
        soles_m = self._soles(
            {name: value.detach() if name in _LENGTHS else value for name, value in values.items()}, near
        )
        standing, contacts = standing_share(self._contacts)[frame], self._contacts[near[0] : near[-1]]
        lifted = lift_cost(self._floor.heights(soles_m[near.index(frame)]), standing)
        return lifted + 0.5 * slip_cost(soles_m[1:] - soles_m[:-1], contacts)

    def _soles(self, values: dict[str, Tensor], frames: list[int]) -> Tensor:
        """Soles in the world in n frames [m], shape (n, 4, 3)."""
        skeleton, _ = self._shaped(values)
        A = self._transforms(values, skeleton, frames)
        R_canonical_tpose = self._skeletons.R_tpose_canonical[0].mT[SOLE_JOINTS]
        below = torch.exp(values["size"]) * (R_canonical_tpose @ self._soles_m[..., None])[..., 0]
        return carry(A[:, SOLE_JOINTS], skeleton.canonical_m[0, SOLE_JOINTS] + below)

    def _find_contacts(self) -> None:
        """Find the floor, and which soles stand on it, in the motion as it is now."""
        values, frames = {name: torch.from_numpy(value) for name, value in self.values.items()}, range(len(self._R0))
        soles_m = self._soles(values, list(frames))
        # The second axis of the pelvis is along the spine: the film's world need not stand upright.
        R, _ = self._moved(values, list(frames))
        spine = torch.stack([R[:, 0, 0, 1], -R[:, 0, 2, 1], R[:, 0, 1, 1]], dim=1).mean(dim=0)
        floor = find_floor(soles_m, (spine / spine.norm()).numpy())
        if floor is not None:
            self._contacts = find_contacts(soles_m, floor)
            self._floor = settle_floor(soles_m, self._contacts, floor)

    def _shaped(self, lengths: dict[str, Tensor]) -> tuple[Skeletons, Tensor]:
        s, bones = torch.exp(lengths["size"][0]), self._likely_bones + lengths["bones"]
        along = torch.exp(bones)[self._group]
        offsets = (self._likely_offsets + lengths["offsets"])[self._group] * self._mirror
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

    def _prior_loss(self, values: dict[str, Tensor]) -> Tensor:
        """How unlikely motion and lengths are."""
        motion = (values["pose"] ** 2).mean() + (values["root"] ** 2).mean()
        lengths = (values["bones"] ** 2).mean() / BONE_SIGMA**2 + (values["size"][0] / SIZE_SIGMA) ** 2
        lengths = lengths + (values["offsets"] ** 2).mean() / _OFFSET_SIGMA_M**2
        total: Tensor = self._weight * motion + _LENGTHS_WEIGHT * lengths
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
