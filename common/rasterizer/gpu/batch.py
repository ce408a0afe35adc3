"""What is drawn in one go: cameras and the people that each of them sees, as tensors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.rasterizer.cpu.rasterizer import PosedPerson


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """B cameras with up to P people each."""

    T_world_camera: Tensor
    """Camera poses, OpenCV axes, float64, shape (B, 4, 4)."""
    avatar: Tensor
    """Avatar of each person, -1: nobody, int32, shape (B, P)."""
    root_m: Tensor
    """Pelvises in the z-up world [m], float64, shape (B, P, 3)."""
    pose_axis_angle: Tensor
    """Joint rotations [rad] as in `Motion`, float64, shape (B, P, 24, 3)."""

    def part(self, first: int, end: int) -> "Batch":
        """Some of the cameras."""
        return Batch(
            T_world_camera=self.T_world_camera[first:end],
            avatar=self.avatar[first:end],
            root_m=self.root_m[first:end],
            pose_axis_angle=self.pose_axis_angle[first:end],
        )


def make_batch(
    T_world_camera: npt.ArrayLike,
    people: Sequence[Sequence[PosedPerson]],
    avatar_count: int,
    device: torch.device | str,
) -> Batch:
    """Check cameras and people, and copy them to a device.

    Args:
        T_world_camera: Camera poses, OpenCV axes, shape (B, 4, 4).
        people: People that each camera sees, B sequences.
        avatar_count: Number of avatars.
        device: Where to.

    Raises:
        ValueError: If a pose is not a finite 4x4 matrix, the lengths differ, or a person is no valid one.
    """
    T = np.asarray(T_world_camera, dtype=np.float64)
    if T.ndim != 3 or T.shape[1:] != (4, 4) or not np.isfinite(T).all():
        raise ValueError(f"T_world_camera must be finite 4x4 matrices, shape (B, 4, 4), got shape {T.shape}.")
    if len(people) != len(T):
        raise ValueError(f"people must have one sequence per camera, got {len(people)} for {len(T)} cameras.")
    most = max((len(group) for group in people), default=0)
    avatar = np.full((len(T), most), -1, dtype=np.int32)
    root, pose = np.zeros((len(T), most, 3)), np.zeros((len(T), most, 24, 3))
    everyone = [person for group in people for person in group]
    if everyone:
        for person in everyone:
            if not 0 <= person.avatar < avatar_count:
                raise ValueError(f"avatar must be 0..{avatar_count - 1}, got {person.avatar}.")
        camera = np.repeat(np.arange(len(T)), [len(group) for group in people])
        place = np.concatenate([np.arange(len(group)) for group in people])
        avatar[camera, place] = [person.avatar for person in everyone]
        root[camera, place] = np.array([person.root_m for person in everyone])
        pose[camera, place] = np.array([person.pose_axis_angle for person in everyone])
    if not (np.isfinite(root).all() and np.isfinite(pose).all()):
        raise ValueError("root_m and pose_axis_angle of people must be finite; got some that are not.")
    return Batch(
        T_world_camera=torch.from_numpy(T).to(device),
        avatar=torch.from_numpy(avatar).to(device),
        root_m=torch.from_numpy(root).to(device),
        pose_axis_angle=torch.from_numpy(pose).to(device),
    )
