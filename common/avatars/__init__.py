"""Avatars: their file, their skeleton and their posing."""

from common.avatars.avatar import SMPL_PARENTS, Avatar

__all__ = ["SMPL_PARENTS", "Avatar"]
