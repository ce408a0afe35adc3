"""What an import found, did and left out."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class SkeletonReport:
    """How a foreign skeleton became SMPL's."""

    bone_of_joint: dict[str, str]
    """SMPL joint -> bone of the file that gave its place."""
    estimated: tuple[str, ...]
    """SMPL joints without a bone, placed by the measures of the body."""
    merged: dict[str, str]
    """Bone of the file that has no SMPL joint -> SMPL joint that moves its skin."""
    source: str
    """How bones were recognised: "names", "humanoid extension" or "geometry"."""


@dataclass(frozen=True, kw_only=True)
class ImportReport:
    """One import."""

    kind: str
    name: str
    license: str
    gaussians: int
    height_m: float
    scale: float
    """Factor from the file's unit of length to metres."""
    skeleton: SkeletonReport | None = None
    notes: tuple[str, ...] = field(default=())
    """What one should know of the result, a sentence each."""

    def as_json(self) -> dict[str, Any]:
        """Plain values for `json.dumps`."""
        skeleton = self.skeleton
        return {
            "kind": self.kind,
            "name": self.name,
            "license": self.license,
            "gaussians": self.gaussians,
            "height_m": self.height_m,
            "scale": self.scale,
            "skeleton": skeleton
            and {
                "source": skeleton.source,
                "bone_of_joint": skeleton.bone_of_joint,
                "estimated": list(skeleton.estimated),
                "merged": skeleton.merged,
            },
            "notes": list(self.notes),
        }
