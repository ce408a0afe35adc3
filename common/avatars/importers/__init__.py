"""People from elsewhere: HUGS checkpoints, SMPL models, glTF figures and bound Gaussians become avatar files."""

from common.avatars.importers.imports import ImportOptions, import_person
from common.avatars.importers.kinds import FileKind, kind_of
from common.avatars.importers.report import ImportReport, SkeletonReport
from common.avatars.importers.smpl_model import SmplModel, load_smpl_model

__all__ = [
    "FileKind",
    "ImportOptions",
    "ImportReport",
    "SkeletonReport",
    "SmplModel",
    "import_person",
    "kind_of",
    "load_smpl_model",
]
