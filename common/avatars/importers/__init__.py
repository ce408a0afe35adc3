"""Humans from elsewhere: HUGS checkpoints, SMPL models, glTF figures and bound Gaussians become avatar files."""

from readygo.common.avatars.importers.imports import ImportOptions, import_human
from readygo.common.avatars.importers.kinds import FileKind, kind_of
from readygo.common.avatars.importers.report import ImportReport, SkeletonReport
from readygo.common.avatars.importers.smpl_model import SmplModel, load_smpl_model

__all__ = [
    "FileKind",
    "ImportOptions",
    "ImportReport",
    "SkeletonReport",
    "SmplModel",
    "import_human",
    "kind_of",
    "load_smpl_model",
]
