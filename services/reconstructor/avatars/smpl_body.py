"""The user's SMPL body as the start of a fit: its surface, joints and skinning weights, in the shape of the footage."""

from dataclasses import replace
from pathlib import Path

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.importers import load_smpl_model
from readygo.common.avatars.importers.assemble import assemble_avatar
from readygo.common.avatars.importers.smpl_human import smpl_human
from readygo.common.frames import zup_from_yup
from readygo.services.reconstructor.avatars.footage import SMPL_PELVIS_M, Footage

GAUSSIANS = 40_000
"""Gaussians of the body, about as many as the embedded avatars have."""


def check_smpl_body(path: Path) -> None:
    """Raise AvatarError if `read_smpl_body` could not read a file for any footage."""
    smpl_human(load_smpl_model(path), count=GAUSSIANS)


def read_smpl_body(path: Path, footage: Footage) -> tuple[Avatar, Footage, Float64Array]:
    """The body, the footage with the pelvis where this body has it, and the pelvis in SMPL's frame [m], shape (3,).

    Args:
        path: A SMPL model of 24 joints (.npz, .pkl).
        footage: Its `betas` give the shape, if it has some.

    Raises:
        AvatarError: If the file is no SMPL model, of another version, or has no faces.
    """
    shaped = footage.betas is not None and bool(footage.betas.any())
    model = load_smpl_model(path, betas=footage.betas if shaped else None)
    human, _ = smpl_human(model, count=GAUSSIANS)
    body, _ = assemble_avatar(human, name=path.stem, license_text="The license of the SMPL model.")
    if footage.betas is None:
        return body, footage, model.joints_m[0]
    moved_m = zup_from_yup(model.joints_m[0] - SMPL_PELVIS_M)
    return body, replace(footage, root_m=footage.root_m + moved_m), model.joints_m[0]
