"""`readygo avatar extract`: an avatar of a person in a video."""

import json as json_module
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from tyro.conf import Fixed, Positional

from readygo.apps.avatar.output import check_avatar_out
from readygo.apps.cli import NOTHING_SAVED
from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.terminal import PlainConsole
from readygo.common.avatars import POSES_ENDING, check_texts, save_avatar
from readygo.common.errors import AvatarError, ConfigError
from readygo.common.extras import install_command
from readygo.common.files import write_then_rename, write_whole
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.files import load_gaussians
from readygo.runs.scene_argument import open_scene
from readygo.runs.sections import Keys, Sections, with_file, with_keys
from readygo.services.animator import skeleton_of
from readygo.services.reconstructor import (
    AvatarFitConfig,
    AvatarPreset,
    Extraction,
    ExtractionProgress,
    PersonNetworks,
    avatar_preset,
)


@dataclass(frozen=True, kw_only=True)
class NetworkFiles:
    """Networks of the user, for what FOOTAGE lacks."""

    keypoint_model: Path | None = None
    """ONNX file of a network such as RTMPose, which finds keypoints where FOOTAGE has neither these nor poses."""
    mask_model: Path | None = None
    """ONNX file of a network that finds the person, where FOOTAGE has no masks."""


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """What is known of a video's camera, which stands still; see --camera.height-m."""

    intrinsics: str = ""
    """Its lens: a calibration of OpenCV or ROS, a .json of cameras, or "fx fy cx cy" in pixels of upright frames."""


@dataclass(frozen=True, kw_only=True)
class AvatarExtractOptions:
    """Extract an avatar from the images of one person, with masks, cameras and body poses or keypoints.

    FOOTAGE has the layout of NeuMan's data, or the plain one (masks/, cameras.json, and poses.npz or keypoints.npz), or
    is a video.
    Writes the avatar, and beside it NAME.html (held-out frames, new poses, unseen parts) and NAME.poses.npz (poses as
    they were found). After an interruption the same command resumes from NAME.work.
    """

    footage: Positional[Path]
    """Folder with images, masks, cameras, and poses or keypoints of one person; or a video from a camera that stands
    still, with masks/, poses.npz or keypoints.npz beside it."""
    out: Path
    """Avatar file (.npz) to write."""
    preset: AvatarPreset = "draft"
    """draft takes minutes on one core; standard takes longer and keeps larger images."""
    body: Path | None = None
    """Your SMPL model (.npz, .pkl) to begin with, in the shape of the footage; an embedded avatar by default."""
    scene: str | None = None
    """Scene of the place without the person, in the frame of FOOTAGE's cameras: a bundle, "embedded", or a file of
    Gaussians. Masks then need not be exact."""
    checkpoint: Path | None = None
    """Also write a HUGS checkpoint (.pth), of --representation hugs with --body; `readygo avatar import` reads it."""
    name: str | None = None
    """Name of the avatar; that of the file by default."""
    license: str = "No license is given: ask the person who was filmed."
    """License of the avatar, recorded in the file."""
    seed: int = 0
    """Seed of the fit."""
    json: bool = False
    """Print the report as JSON."""
    config: Path | None = None
    """TOML file with settings; `--KEY VALUE` and `--SECTION.KEY VALUE` override it."""
    models: NetworkFiles = field(default_factory=NetworkFiles)
    video: VideoOptions = field(default_factory=VideoOptions)
    keys: Annotated[Keys, Sections(AvatarFitConfig), Fixed] = field(default_factory=dict)


def avatar_extract(options: AvatarExtractOptions) -> None:
    """Extract an avatar from the images of one person, with masks, cameras and body poses or keypoints."""
    check_avatar_out(options.out, _inputs(options), (options.out.with_suffix(POSES_ENDING), options.checkpoint))
    check_texts(options.name or options.out.stem, options.license)
    config = replace(avatar_preset(options.preset), seed=options.seed)
    told = {"camera": {"intrinsics": options.video.intrinsics}} if options.video.intrinsics else {}
    config = with_keys(with_keys(with_file(config, options.config), told), options.keys)
    if options.checkpoint is not None and (config.representation != "hugs" or options.body is None):
        raise ConfigError(
            "--checkpoint needs --representation hugs, and --body with the SMPL model whose skeleton it goes with."
        )
    work = options.out.with_suffix(".work")
    try:
        extraction = _extract(options, config, work)
        notes = _write(options, extraction)
    except KeyboardInterrupt:
        # The extraction removes its folder if nothing in it is finished.
        state = f"the same command resumes from the state in {work}."
        raise KeyboardInterrupt(state if work.exists() else NOTHING_SAVED) from None
    from readygo.services.reconstructor import forget_extraction

    forget_extraction(work)
    if options.json:
        sys.stdout.write(json_module.dumps({**extraction.report, "out": str(options.out)}) + "\n")
    else:
        _print_report(options.out, extraction)
    for note in notes:
        PlainConsole(stderr=True, soft_wrap=True).print(f"Note: {note}", markup=False)


def _inputs(options: AvatarExtractOptions) -> list[Path | None]:
    """Files and folders that the avatar is made from."""
    scene = None if options.scene is None else Path(options.scene)
    return [
        options.footage,
        options.body,
        scene,
        options.config,
        options.models.keypoint_model,
        options.models.mask_model,
    ]


def _write(options: AvatarExtractOptions, extraction: Extraction) -> list[str]:
    """Write the avatar and what belongs to it; returns notes on the page."""
    skeleton_of(extraction.avatar)
    save_avatar(extraction.avatar, options.out, quantise=False)
    if options.checkpoint is not None:
        _write_checkpoint(options.checkpoint, extraction)
    _write_poses(options.out.with_suffix(POSES_ENDING), extraction)
    page, notes = _page(extraction)
    write_whole(options.out.with_suffix(".html"), page, raises=AvatarError)
    return notes


def _extract(options: AvatarExtractOptions, config: AvatarFitConfig, work: Path) -> Extraction:
    try:
        from readygo.services.reconstructor import extract_avatar
    except ImportError as error:
        raise ConfigError(f"Avatars from videos need torch; run: {install_command('reconstruct')}") from error
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with SteadyProgress(*columns, transient=True) as progress:

        def tell(at: ExtractionProgress) -> None:
            words = f"step {at.step} of {at.steps}, {at.gaussians:,} Gaussians, loss {at.loss:.4f}, {at.seconds:.0f} s"
            # The bar appears with the first step: what is wrong with the footage is said in one line, without it.
            task = progress.task_ids[0] if progress.task_ids else progress.add_task(words, total=at.steps)
            progress.update(task, completed=at.step, description=words)

        return extract_avatar(
            options.footage,
            work,
            config,
            tell,
            networks=PersonNetworks(keypoints=options.models.keypoint_model, mask=options.models.mask_model),
            name=options.name or options.out.stem,
            license_text=options.license,
            smpl=options.body,
            scene=_clouds_of(options.scene),
        )


def _clouds_of(scene: str | None) -> list[GaussianCloud]:
    """The Gaussians of a scene, and of its sky if it has one.

    Raises:
        SceneError: If there is no such scene or file, or it cannot be read.
    """
    if scene is None:
        return []
    if Path(scene).is_file():
        return [load_gaussians(scene)]
    bundle = open_scene(scene)
    return [cloud for cloud in (bundle.cloud, bundle.sky) if cloud is not None]


def _write_poses(path: Path, extraction: Extraction) -> None:
    with write_then_rename(path, raises=AvatarError) as part:
        np.savez(
            part,
            allow_pickle=False,
            root_m=extraction.root_m.astype(np.float32),
            pose_axis_angle=extraction.pose_axis_angle.astype(np.float32),
            joints_m=extraction.joints_m.astype(np.float32),
        )


def _write_checkpoint(path: Path, extraction: Extraction) -> None:
    import torch

    with write_then_rename(path, raises=AvatarError) as part:
        torch.save(extraction.checkpoint, part)


def _page(extraction: Extraction) -> tuple[str, list[str]]:
    from readygo.apps.avatar.extracted import extraction_page, notes_of

    return extraction_page(extraction), notes_of(extraction.report)


def _print_report(out: Path, extraction: Extraction) -> None:
    report, console = extraction.report, PlainConsole(soft_wrap=True)
    quality = "" if report["psnr_db"] is None else f", held out {report['psnr_db']:.1f} dB, SSIM {report['ssim']:.3f}"
    console.print(
        f"{out}: {extraction.avatar.name}, {report['height_m']:.2f} m tall, {report['gaussians']:,} Gaussians of "
        f"{report['frames']} frames{quality}, {report['seconds'] / 60:.1f} minutes.",
        markup=False,
    )
    console.print(f"Report: {out.with_suffix('.html')}", markup=False)
    console.print(f"Next: readygo generate embedded --avatars {out} --episodes 2 --out data", markup=False)
