"""Avatars: their file, their skeleton and their posing."""

from readygo.common.avatars.avatar import SMPL_PARENTS, Avatar
from readygo.common.avatars.file import (
    POSES_ENDING,
    avatar_hash,
    avatar_paths,
    check_texts,
    load_avatar,
    load_avatars,
    save_avatar,
)
from readygo.common.avatars.footprint import FootprintModel, footprint_xy
from readygo.common.avatars.kinematics import joint_positions, joint_transforms
from readygo.common.avatars.labels import LabelModel, human_labels
from readygo.common.avatars.posing import pose_avatar

__all__ = [
    "POSES_ENDING",
    "SMPL_PARENTS",
    "Avatar",
    "FootprintModel",
    "LabelModel",
    "avatar_hash",
    "avatar_paths",
    "check_texts",
    "footprint_xy",
    "human_labels",
    "joint_positions",
    "joint_transforms",
    "load_avatar",
    "load_avatars",
    "pose_avatar",
    "save_avatar",
]
