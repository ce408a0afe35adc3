"""From the film of a person to an avatar: read, choose a body, fit, measure; resumable."""

import hashlib
import json
import math
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars import Avatar, load_avatars, pose_avatar
from readygo.common.config import section_to_mapping
from readygo.common.errors import RunError
from readygo.common.gaussians import GaussianCloud
from readygo.services.reconstructor.avatars.agreement import check_agreement
from readygo.services.reconstructor.avatars.body import compare_bodies, overlap_of, weights_of
from readygo.services.reconstructor.avatars.complete import (
    STAGE_FOLDERS,
    CompleteFootage,
    PersonNetworks,
    complete_footage,
)
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.export import avatar_of_fit, without_floaters
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.footage import SMPL_PELVIS_M, Footage
from readygo.services.reconstructor.avatars.hugs import HugsFit
from readygo.services.reconstructor.avatars.plates import with_plates
from readygo.services.reconstructor.avatars.rig import BoneLengths, mean_lengths
from readygo.services.reconstructor.avatars.smpl_body import check_smpl_body, read_smpl_body
from readygo.services.reconstructor.avatars.surroundings import Surroundings
from readygo.services.reconstructor.avatars.trajectory import (
    PoseTrajectory,
    smoothed_trajectory,
    trusted_trajectory,
)
from readygo.services.reconstructor.avatars.views import PersonView, read_person, view_at
from readygo.services.reconstructor.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.stages import Stages, code_digest, identity_of, word_errors
from readygo.services.reconstructor.training.checkpoint import CHECKPOINT_FILE, load_checkpoint, save_checkpoint
from readygo.services.reconstructor.training.interruption import interruption
from readygo.services.reconstructor.training.photometric import Photometric

GREY = 0.5
"""Background that photos and drawn people are compared before."""
FLOATER_M = 0.05
"""Gaussians that are this far from all others are left out [m]."""
_SAVE_EVERY_S, _TELL_EVERY_S = 60.0, 1.0


@dataclass(frozen=True, kw_only=True)
class ExtractionProgress:
    """How far an extraction is."""

    step: int
    steps: int
    gaussians: int
    loss: float
    seconds: float
    """Spent so far, those before an interruption included."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOutPerson:
    """A frame of which the pose alone was found, and what the avatar looks like there."""

    image: str
    psnr_db: float
    """Over the pixels of the mask."""
    ssim: float
    """Of the cut-out before grey."""
    photo: Float32Array
    """The person before grey, shape (3, H, W)."""
    rendered: Float32Array
    """The avatar before grey, shape (3, H, W)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Extraction:
    """What an extraction gives."""

    avatar: Avatar
    held_out: list[HeldOutPerson]
    pose_axis_angle: Float64Array
    """Poses as they were found [rad], shape (F, 24, 3)."""
    root_m: Float64Array
    """Pelvises as they were found [m], shape (F, 3)."""
    joints_m: Float64Array
    """Joints as they were found, in the film's world [m], shape (F, 24, 3)."""
    report: dict[str, Any]
    """Numbers: `psnr_db` and `ssim` (means of the held-out frames, None without any), `gaussians`, `dropped` (faint
    Gaussians and floaters that are left out), `dropped_db` (what that costs at the held-out frames), `height_m`,
    `body`, `overlap`, `unseen` (share by part of the body), `frames`, `steps`, `seconds`, `notes`, `settings`."""
    checkpoint: dict[str, Any] | None = None
    """Planes and decoders in the layout of HUGS' checkpoints, if it is represented so."""


def extract_avatar(
    folder: Path,
    work: Path,
    config: AvatarFitConfig,
    tell: Callable[[ExtractionProgress], None],
    *,
    name: str,
    license_text: str,
    networks: PersonNetworks | None = None,
    bodies: dict[str, Avatar] | None = None,
    smpl: Path | None = None,
    scene: Sequence[GaussianCloud] = (),
) -> Extraction:
    """Extract an avatar; an interrupted call resumes with the same arguments, to the same result.

    Args:
        folder: Film of a person, see `footage`, or a video from a camera that stands still.
        work: Folder of what is found and of the checkpoint; it goes if the film cannot be used.
        config: How; see `avatar_preset`.
        tell: Is told about every second how far it is.
        name: Name of the avatar.
        license_text: Its license.
        networks: Find masks and keypoints that the film lacks.
        bodies: Bodies to begin with by name; the embedded avatars by default.
        smpl: SMPL model file whose body is begun with instead, in the shape that the footage tells.
        scene: Gaussians of the place, in the world of the footage's cameras; masks then need not be exact.

    Raises:
        ReadygoError: If the film cannot be used, or the fit does not come to a human.
        KeyboardInterrupt: At Ctrl-C, after the state is saved.
    """
    bodies = load_avatars() if bodies is None else bodies
    stages = Stages(work, lambda _: None)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with stages.alone(), word_errors(work):
            if smpl is not None:
                check_smpl_body(smpl)
            complete = complete_footage(folder, stages, networks or PersonNetworks(), bodies, config)
            fit, footage, overlap = _begin_fit(complete, bodies, smpl, config, scene)
            seconds = _run(fit, work, _identity(footage, fit), tell)
        avatar, unseen = avatar_of_fit(fit, fit.body, name, license_text)
        avatar = without_floaters(avatar, FLOATER_M)
        pose, root_m = fit.rig.poses()
        held_out = [
            measure_frame(avatar, view_at(fit.person, frame, 1), pose[frame], root_m[frame], footage.names[frame])
            for frame in fit.held
        ]
        whole_db = [_whole_psnr_db(fit, frame) for frame in fit.held]
    finally:
        torch.set_num_threads(threads)
    report = {
        "psnr_db": round(float(np.mean([each.psnr_db for each in held_out])), 3) if held_out else None,
        "ssim": round(float(np.mean([each.ssim for each in held_out])), 4) if held_out else None,
        "gaussians": len(avatar.cloud),
        "dropped": len(fit) - len(avatar.cloud),
        "dropped_db": round(float(np.mean(whole_db)) - float(np.mean([each.psnr_db for each in held_out])), 3)
        if held_out
        else None,
        "height_m": avatar.height_m,
        "body": fit.body.name,
        "overlap": round(overlap, 3),
        "unseen": unseen,
        "frames": len(fit.person),
        "steps": config.steps,
        "seconds": round(seconds, 1),
        "notes": [*complete.notes, *fit.person.notes],
        "settings": section_to_mapping(fit.config),
    }
    return Extraction(
        avatar=avatar,
        held_out=held_out,
        pose_axis_angle=pose,
        root_m=root_m,
        joints_m=fit.rig.joints(),
        report=report,
        checkpoint=fit.released() if isinstance(fit, HugsFit) else None,
    )


def forget_extraction(work: Path) -> None:
    """Remove the checkpoint of an extraction whose result is written, and its folder if nothing else lies there."""
    with Stages(work, lambda _: None).alone():
        for stage in STAGE_FOLDERS:
            shutil.rmtree(work / stage, ignore_errors=True)
        (work / CHECKPOINT_FILE).unlink(missing_ok=True)


def measure_frame(
    avatar: Avatar, view: PersonView, pose: Float64Array, root_m: Float64Array, image: str
) -> HeldOutPerson:
    """Compare the person of a frame with the avatar in the pose that was found there.

    Args:
        avatar: The avatar.
        view: The frame.
        pose: Rotations of the joints [rad], shape (24, 3).
        root_m: The pelvis in the film's world [m], shape (3,).
        image: Name of the frame's image.
    """
    cloud = pose_avatar(avatar, root_m, pose)
    arrays = (cloud.means_m, cloud.quats_wxyz, cloud.scales_m, cloud.opacities, cloud.sh)
    rendered = rasterize(
        *(torch.from_numpy(np.ascontiguousarray(array)) for array in arrays),
        T_world_camera=torch.from_numpy(view.T_world_camera),
        K_px=view.K_px,
        height_px=view.mask.shape[0],
        width_px=view.mask.shape[1],
        sh_degree=cloud.sh_degree,
    )
    return compare_person(image, view, _before_grey(rendered))


def _before_grey(rendered: Rendered) -> Float32Array:
    """A person drawn over black before grey, shape (3, H, W)."""
    assert rendered.rgb is not None
    colours, left = rendered.rgb.detach().permute(2, 0, 1).numpy(), rendered.transmittance.detach().numpy()
    return np.clip(colours + GREY * left, 0.0, 1.0).astype(np.float32)


def _whole_psnr_db(fit: PersonFit, frame: int) -> float:
    """PSNR in the mask of a frame with all Gaussians of the fit."""
    view = view_at(fit.person, frame, 1)
    return compare_person("", view, _before_grey(fit.draw(frame, view, alone=True).rendered)).psnr_db


def compare_person(image: str, view: PersonView, drawn: Float32Array) -> HeldOutPerson:
    """A drawn person before grey (3, H, W) beside the filmed one."""
    photo = (view.rgb * view.mask + GREY * (1.0 - view.mask)).astype(np.float32)
    inside = view.mask > 0.5
    error = float(np.mean(np.square((drawn - photo)[:, inside], dtype=np.float64)))
    drawn = np.ascontiguousarray(drawn)
    _, ssim, _ = Photometric(*inside.shape)(drawn, photo, 1.0)
    psnr_db = -10.0 * math.log10(max(error, 1e-12))
    return HeldOutPerson(image=image, psnr_db=psnr_db, ssim=ssim, photo=photo, rendered=drawn)


def _begin_fit(
    complete: CompleteFootage,
    bodies: dict[str, Avatar],
    smpl: Path | None,
    config: AvatarFitConfig,
    scene: Sequence[GaussianCloud],
) -> tuple[PersonFit, Footage, float]:
    """A fit on the body whose silhouettes are most like the person's, its footage, and their overlap."""
    pelvis_m = SMPL_PELVIS_M
    if smpl is not None:
        body, footage, pelvis_m = read_smpl_body(smpl, complete.footage)
        bodies, complete = {body.name: body}, replace(complete, footage=footage)
    person = read_person(complete.footage, config.side_max_px)
    trajectory, around = _trajectory(complete, config), None
    if scene:
        person = with_plates(person, scene)
        around = Surroundings(scene, person, trajectory.root_m, config.steps) if config.joint_scene else None
    pose, root = trajectory.pose_axis_angle, trajectory.root_m
    hugs = config.representation == "hugs"
    if hugs and smpl is not None:
        # Checkpoints have no skeleton: it stays that of the file.
        overlap = overlap_of(body, person, pose, root)
        likely = BoneLengths.of_body()
    else:
        compared = compare_bodies(bodies, person, pose, root)
        body, overlap = compared[0].body, compared[0].overlap
        likely = mean_lengths(body, [each.body for each in compared], weights_of(compared))
    notes = check_agreement(body, overlap, person, pose, root)
    person = replace(person, notes=(*person.notes, *notes))
    fit = (
        HugsFit(
            body,
            person,
            trajectory,
            config,
            likely,
            pelvis_m=pelvis_m,
            fixed_lengths=smpl is not None,
            surroundings=around,
        )
        if hugs
        else PersonFit(body, person, trajectory, config, likely, around)
    )
    return fit, complete.footage, overlap


def _trajectory(complete: CompleteFootage, config: AvatarFitConfig) -> PoseTrajectory:
    """The motion to begin with, and how far it is trusted."""
    footage, prior, keypoints = complete.footage, config.prior, config.keypoints
    given = footage.pose_axis_angle, footage.root_m
    if complete.poses_found:
        return trusted_trajectory(
            *given,
            joint_deg=keypoints.joint_deg,
            root_sd_m=keypoints.root_m,
            jerk_deg=prior.jerk_deg,
            jerk_m=prior.jerk_m,
            times=footage.times,
        )
    if prior.in_order:
        return smoothed_trajectory(*given, prior, times=footage.times)
    return trusted_trajectory(*given, joint_deg=prior.joint_deg, root_sd_m=prior.root_m)


def _run(fit: PersonFit, work: Path, identity: str, tell: Callable[[ExtractionProgress], None]) -> float:
    """Fit to the end; the time that it took in all [s]."""
    spent_s, begin_s = 0.0, time.monotonic()
    found = load_checkpoint(work, identity)
    if found is not None:
        fit.load(int(found[0]["step"]), found[1])
        spent_s = float(found[0]["seconds"])
    saved_s = told_s = begin_s
    with interruption() as interrupted:
        while fit.step < fit.config.steps:
            fit.one_step()
            if not math.isfinite(fit.loss):
                raise RunError(f"Step {fit.step} gave a number that is not finite; look at the images and poses.")
            now_s = time.monotonic()
            if interrupted() or now_s - saved_s > _SAVE_EVERY_S or fit.step == fit.config.steps:
                numbers = {"step": fit.step, "seconds": spent_s + now_s - begin_s}
                save_checkpoint(work, identity, numbers, dict(fit.state()))
                saved_s = now_s
            if interrupted():
                raise KeyboardInterrupt
            if now_s - told_s > _TELL_EVERY_S or fit.step == fit.config.steps:
                tell(
                    ExtractionProgress(
                        step=fit.step,
                        steps=fit.config.steps,
                        gaussians=len(fit),
                        loss=fit.loss,
                        seconds=spent_s + now_s - begin_s,
                    )
                )
                told_s = now_s
    return spent_s + time.monotonic() - begin_s


def _identity(footage: Footage, fit: PersonFit) -> str:
    digest = hashlib.sha256(json.dumps(section_to_mapping(fit.config), sort_keys=True).encode())
    digest.update(code_digest("avatars", "differentiable", "training").encode())
    digest.update(f"{fit.body.name} {fit.body.height_m!r}".encode())
    digest.update(fit.likely_joints_m.tobytes())
    for plate in fit.person.plates or ():
        digest.update(plate.tobytes())
    if fit.surroundings is not None:
        for learned in fit.surroundings.state().values():
            digest.update(learned.tobytes())
    digest.update(json.dumps(identity_of([*footage.images, *footage.masks])).encode())
    for array in (footage.K_px, footage.T_world_camera, footage.root_m, footage.pose_axis_angle):
        digest.update(array.tobytes())
    return digest.hexdigest()
