"""From a video or photos to a scene bundle: poses, Gaussians, maps, in stages on disk, without a bus."""

import importlib.util
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from readygo.common.config import section_to_mapping
from readygo.common.errors import ConfigError, NoGroundError, SceneError
from readygo.common.extras import install_command
from readygo.common.files import unfinished_folder
from readygo.common.gaussians.defects import BACKGROUND, count_kinds, told_apart, without
from readygo.common.gaussians.files import read_gaussians
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.scenes import Scene, SceneSource, load_scene, save_scene
from readygo.common.scenes.manifest import file_of
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.handlers import find_poses_in, open_job
from readygo.services.reconstructor.job import POSE_STAGES, POSED
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.stages import Say, StageProgress, code_digest
from readygo.services.reconstructor.training.config import Device

GAUSSIANS, SCENE = "gaussians", "scene"
"""Stages after those of the poses."""
STAGES = (*POSE_STAGES, GAUSSIANS, SCENE)
CLOUD_FILE = "gaussians.ply"
_BUNDLE = "bundle"


@dataclass(frozen=True, kw_only=True)
class Job:
    """Source, results and folders of a reconstruction."""

    source: Path
    """A video, a folder of photos, or a folder with a COLMAP model and its images."""
    out: Path
    """The scene bundle; must not exist, unless this job made it."""
    work: Path
    """State folder; what is finished there is not done again."""
    license: str = ""


def reconstruct_scene(job: Job, config: ReconstructorConfig, say: Say) -> dict[str, Any]:
    """Make a scene bundle.

    Args:
        job: What of what.
        config: How.
        say: Hears when a stage begins, and how far it is.

    Returns:
        The report: that of the poses, `training` (as of `train_gaussians`), `removed` (Gaussians, in words), `sky`
        (number of those that are far surroundings), `scene` (folder), `content_hash` and `seconds` (by stage).

    Raises:
        ReadygoError: If it cannot be made; the message says why, and finished stages stay.
    """
    _check_out(job)
    check_installed(config.gaussians.device)
    with open_job(job.source, job.work, config, say) as (stages, source):
        report = find_poses_in(stages, source, config)
        trained = stages.run(
            GAUSSIANS,
            section_to_mapping(config.gaussians),
            _training(job.work, config, say),
            code=code_digest("training", "differentiable"),
            keep=True,
        )
        # Interrupted trainings resume: their own clock includes the time before.
        stages.seconds[GAUSSIANS] = round(sum(trained["seconds"].values()), 2)
        made = {**report, "training": trained}
        found = stages.run(SCENE, {"license": job.license, "name": job.out.name}, partial(make_scene, job, made))
        scene = _publish(job.work / SCENE / _BUNDLE, job.out)
    return {**made, **found, "scene": str(job.out), "content_hash": scene.content_hash,
            "seconds": stages.seconds}  # fmt: skip


def _check_out(job: Job) -> None:
    """Before hours of work, not after them."""
    if job.out.exists() and not (job.work / SCENE / _BUNDLE).is_dir():
        raise SceneError(f"{job.out} exists already; choose another folder, or remove it.")


def check_installed(device: Device = "cpu") -> None:
    """Before minutes of work, not after them.

    Args:
        device: Where Gaussians will be trained.

    Raises:
        ReadygoError: If a package or the device is missing.
    """
    if any(importlib.util.find_spec(name) is None for name in ("pycolmap", "torch")):
        raise ConfigError(f"Reconstructing needs pycolmap and torch; run: {install_command('reconstruct')}")
    if device == "cuda":
        require_kernels("gsplat", device)


def _training(work: Path, config: ReconstructorConfig, say: Say) -> Callable[[Path], dict[str, Any]]:
    """The stage that trains Gaussians in a folder."""
    from readygo.services.reconstructor.training.progress import TrainingProgress
    from readygo.services.reconstructor.training.train import train_gaussians

    def tell(state: TrainingProgress) -> None:
        quality = "" if state.psnr_db is None else f", {state.psnr_db:.1f} dB"
        words, share = (
            f"step {state.step} of {state.steps}, {state.gaussians:,} Gaussians{quality}",
            state.step / state.steps,
        )
        if state.searches:
            words, share = f"searching for what moved, step {state.step} of {state.steps}", 0.0
        say(StageProgress(stage=GAUSSIANS, share=share, words=words, picture=state.picture))

    return lambda folder: train_gaussians(work / POSED, folder, config.gaussians, tell)


def make_scene(job: Job, report: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The bundle with its maps and cameras; Gaussians that spoil it are left out and counted, far ones are its sky.

    Raises:
        SceneError: If the scene has too little floor to move on.
    """
    file = job.work / GAUSSIANS / CLOUD_FILE
    trained = read_gaussians(file)
    masks = told_apart(trained)
    sky, rest = (trained.select(part) for part in (masks[BACKGROUND], ~masks[BACKGROUND]))
    removed = {kind: mask[~masks[BACKGROUND]] for kind, mask in masks.items() if kind != BACKGROUND}
    cloud, _ = without(rest, removed)
    source = SceneSource(
        file=job.source.name,
        kind=f"reconstructed from {report['kind']}",
        sha256=file_of(file.parent, file.name).sha256,
        scale=1.0,
        scale_origin=report["scale"]["source"],
        edits=(f"removed {count_kinds(removed)}",),
    )
    views = colmap.pinhole_views(job.work / POSED / "sparse" / "0")
    try:
        save_scene(
            cloud,
            sky if len(sky) else None,
            folder / _BUNDLE,
            name=job.out.name,
            license=job.license,
            source=source,
            views=views,
            reconstruction=_kept_in_scene(job, report),
        )
    except NoGroundError as error:
        raise SceneError(
            f"{error} What the Gaussians look like: {job.work / GAUSSIANS / 'previews'}; train longer "
            "(--gaussians.steps, "
            "--preset standard), and film the floor as well."
        ) from error
    return {"removed": count_kinds(removed), "sky": len(sky)}


def _kept_in_scene(job: Job, report: dict[str, Any]) -> dict[str, Any]:
    """The report without what differs from one machine or time to another: the same work gives the same scene."""
    training = {name: value for name, value in report["training"].items() if name not in ("seconds", "gpu_bytes")}
    kept = {name: report[name] for name in ("kind", "verdict", "scale", "up", "markers", "notes")}
    return {**kept, "source": job.source.name, "training": training}


def _publish(bundle: Path, out: Path) -> Scene:
    """Copy a finished bundle to where it is wanted.

    Raises:
        SceneError: If something else is there.
    """
    made = load_scene(bundle)
    if not out.exists():
        with unfinished_folder(out, raises=SceneError) as folder:
            shutil.copytree(bundle, folder, dirs_exist_ok=True)
    elif load_scene(out).content_hash != made.content_hash:
        raise SceneError(
            f"{out} holds a scene that was made from something else; remove it, and run the same command again: "
            "nothing has to be computed again."
        )
    return load_scene(out)
