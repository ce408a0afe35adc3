"""`readygo avatar capture`: simulated footage of an avatar, with ground truth, to measure `avatar extract` with."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rich.progress import Progress
from tyro.conf import Positional

from readygo.apps.commands.avatar import file_of_avatar
from readygo.apps.terminal import PlainConsole
from readygo.common.avatars import load_avatar
from readygo.runs.scene_argument import open_scene


@dataclass(frozen=True, kw_only=True)
class CaptureNoise:
    """Errors of what the footage holds beside the images."""

    pose_noise_deg: float = 3.0
    """Standard deviation of the rotation of every joint about each axis, in each frame [deg]."""
    pose_noise_m: float = 0.02
    """Standard deviation of the pelvis along each axis, in each frame [m]."""
    keypoint_noise_px: float = 3.0
    """Standard deviation of visible keypoints along each axis, in each frame [px]; hidden ones have twice as much."""
    mask_noise_px: float = 0.0
    """Standard deviation of where the masks' borders are, in each frame [px]: dents and bumps, as of a network."""


@dataclass(frozen=True, kw_only=True)
class AvatarCaptureOptions:
    """Record a simulated video of an avatar, as images with masks, cameras and disturbed body poses.

    OUT has the layout of NeuMan's data: images/, segmentations/, a COLMAP model in sparse/, and SMPL poses in
    4d_humans/. truth.npz and truth.json beside them hold the true poses.
    """

    avatar: Positional[Path]
    """Avatar file, or the name of an embedded avatar."""
    out: Path
    """New folder to write."""
    motion: Literal["walk", "turn"] = "walk"
    """What the person does: walk a circle, or turn on the spot."""
    layout: Literal["neuman", "plain"] = "neuman"
    """NeuMan's layout, or the plain one of readygo: masks/, cameras.json, poses.npz."""
    frames: int = 100
    """Number of images, 20 a second."""
    walk_radius_m: float = 0.95
    """Radius of the circle that is walked [m]."""
    size: tuple[int, int] = (512, 512)
    """Width and height of the images [px]."""
    body: Literal["poses", "keypoints"] = "poses"
    """What the footage holds of the body: poses, or keypoints.npz with the 26 keypoints of Halpe (layout plain)."""
    scene: str | None = None
    """Scene to film in, whose frame cameras and poses then have; a plain room by default."""
    scene_hides: bool = True
    """False draws the person over the scene: drawn by depth, Gaussians of a floor lie over feet."""
    seed: int = 0
    """Seed of gait, camera and noise."""
    noise: CaptureNoise = field(default_factory=CaptureNoise)


def avatar_capture(options: AvatarCaptureOptions) -> None:
    """Record a simulated video of an avatar, as images with masks, cameras and disturbed body poses."""
    from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar

    config = AvatarCaptureConfig(
        motion=options.motion,
        layout=options.layout,
        frames=options.frames,
        walk_radius_m=options.walk_radius_m,
        width_px=options.size[0],
        height_px=options.size[1],
        pose_noise_deg=options.noise.pose_noise_deg,
        pose_noise_m=options.noise.pose_noise_m,
        body=options.body,
        keypoint_noise_px=options.noise.keypoint_noise_px,
        mask_noise_px=options.noise.mask_noise_px,
        scene_hides=options.scene_hides,
        seed=options.seed,
    )
    avatar = load_avatar(file_of_avatar(options.avatar))
    scene = None if options.scene is None else open_scene(options.scene)
    notes = PlainConsole(stderr=True, soft_wrap=True)
    with Progress(console=notes, transient=True) as progress:
        task = progress.add_task("filming", total=config.frames)
        capture_avatar(avatar, options.out, config, lambda done: progress.update(task, completed=done), scene)
    console = PlainConsole(soft_wrap=True)
    console.print(
        f"{options.out}: {config.frames} images of {config.width_px}x{config.height_px} px of {avatar.name}, with "
        f"masks, cameras, {config.body} and truth. Next: readygo avatar extract {options.out} "
        f"{f'--scene {options.scene} ' if options.scene else ''}--out {avatar.name}.npz",
        markup=False,
    )
