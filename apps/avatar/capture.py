"""A simulated film of an avatar: images, masks, cameras, and disturbed body poses or keypoints, with the truth.

The person walks a circle, or turns on the spot with arms held away from the body, before a plain room or in a scene. A
camera that is held by hand stands still, but for its sway, and follows the person.

truth.npz        T_world_camera (F, 4, 4), root_m (F, 3), pose_axis_angle (F, 24, 3), joints_m (F, 24, 3): in metres,
                 z up, the poses that were drawn
truth.json       format, avatar and its hash, motion, seed and noise
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from readygo.apps.avatar.keypoints import disturb_keypoints, keypoints_in_world, project_keypoints
from readygo.apps.avatar.place import place_in
from readygo.apps.avatar.studio import Framing, look_at, studio_ground
from readygo.apps.avatar.walking import FPS, level_walk
from readygo.common.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.avatars import Avatar, avatar_hash, joint_positions
from readygo.common.drawing.files import write_png
from readygo.common.errors import AvatarError, ConfigError
from readygo.common.files import unfinished_folder, write_whole
from readygo.common.frames import axis_angle_from_matrix, matrix_from_axis_angle
from readygo.common.messages import Motion
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, View
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.scenes import Scene
from readygo.services.reconstructor import (
    KEYPOINTS_FILE,
    Footage,
    Keypoints,
    write_keypoints,
    write_neuman,
    write_plain,
    write_views,
)

TRUTH_FORMAT = "readygo avatar truth 1"
TRUTH_ARRAYS, TRUTH_FILE = "truth.npz", "truth.json"
MASK_ALPHA = 0.5
"""A pixel of which the person covers more is in the mask."""
_FRAMES, _SIDE_PX = (8, 1000), (64, 2048)
_SPEED_MPS, _MIDDLE_X_M = 1.2, 3.0
_ASIDE_M = 0.35
"""Room beside the circle that is walked, in a scene [m]."""
_FOCAL_PER_SIDE = 1.5
_DISTANCE_M, _HEIGHT_M, _SWAY_M = 4.0, 1.35, 0.12
_BLOB_PX = 0.04
"""Size of the dents and bumps of masks with errors, as a share of the image's shorter side."""
_ARMS_RAD = 0.7
"""How far the arms hang below the T-pose while the person turns [rad]."""


@dataclass(frozen=True, kw_only=True)
class AvatarCaptureConfig:
    """How an avatar is filmed."""

    motion: Literal["walk", "turn"] = "walk"
    layout: Literal["neuman", "plain"] = "neuman"
    frames: int = 100
    """Number of images, 20 a second."""
    walk_radius_m: float = 0.95
    """Radius of the circle that is walked."""
    width_px: int = 512
    height_px: int = 512
    pose_noise_deg: float = 3.0
    """Standard deviation of each joint's rotation about each axis, frame by frame."""
    pose_noise_m: float = 0.02
    """Standard deviation of the pelvis along each axis, frame by frame."""
    body: Literal["poses", "keypoints"] = "poses"
    """What the footage holds of the body."""
    keypoint_noise_px: float = 3.0
    """Standard deviation of visible keypoints along each axis, frame by frame."""
    mask_noise_px: float = 0.0
    """Standard deviation of where the masks' borders are, frame by frame."""
    scene_hides: bool = True
    """False draws the person over the scene: by the depths of their centres Gaussians of floors lie over feet."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not _FRAMES[0] <= self.frames <= _FRAMES[1]:
            raise ConfigError(f"--frames must lie in {_FRAMES[0]}..{_FRAMES[1]}, got {self.frames}.")
        for side in (self.width_px, self.height_px):
            if not _SIDE_PX[0] <= side <= _SIDE_PX[1]:
                raise ConfigError(f"--size must lie in {_SIDE_PX[0]}..{_SIDE_PX[1]} px, got {side}.")
        if not 0.4 <= self.walk_radius_m <= 3.0:
            raise ConfigError(f"--walk-radius-m must lie in 0.4..3, got {self.walk_radius_m:g}.")
        if not (0.0 <= self.pose_noise_deg <= 45.0 and 0.0 <= self.pose_noise_m <= 1.0):
            raise ConfigError("--pose-noise-deg must lie in 0..45 and --pose-noise-m in 0..1.")
        if not 0.0 <= self.keypoint_noise_px <= 100.0:
            raise ConfigError(f"--keypoint-noise-px must lie in 0..100, got {self.keypoint_noise_px:g}.")
        if not 0.0 <= self.mask_noise_px <= 50.0:
            raise ConfigError(f"--mask-noise-px must lie in 0..50, got {self.mask_noise_px:g}.")
        if self.body == "keypoints" and self.layout != "plain":
            raise ConfigError("--body keypoints needs --layout plain: NeuMan's layout has poses.")


def capture_avatar(
    avatar: Avatar,
    out: Path,
    config: AvatarCaptureConfig,
    heard: Callable[[int], None],
    scene: Scene | None = None,
) -> None:
    """Film an avatar.

    Args:
        avatar: Whom.
        out: New folder.
        config: How.
        heard: Called with the number of finished frames.
        scene: Where, and whose frame cameras and poses have; None takes a plain room.

    Raises:
        AvatarError: If the folder is there already, or cannot be written, or the scene has no room for the film.
    """
    if out.exists():
        raise AvatarError(f"{out} is there already; give the name of a new folder.")
    rng = np.random.Generator(np.random.Philox(config.seed))
    motion = film_motion(avatar, config)
    cameras = _cameras(avatar, motion, config, rng)
    framing = framing_of(config)
    names = tuple(f"{number:05d}.png" for number in range(config.frames))
    drawer = PersonDrawer(avatar, framing, scene, scene_hides=config.scene_hides)
    if scene is not None:
        middle_m = np.array([_MIDDLE_X_M, config.walk_radius_m])
        T_scene_film = place_in(scene, config.walk_radius_m + _ASIDE_M, middle_m, middle_m - (0.0, _DISTANCE_M))
        motion, cameras = _moved_motion(motion, T_scene_film), T_scene_film @ cameras
    smudges = np.random.Generator(np.random.Philox([config.seed, 2]))
    with unfinished_folder(out, raises=AvatarError) as folder:
        masks = "segmentations" if config.layout == "neuman" else "masks"
        for row, name in enumerate(names):
            rgb, mask = drawer.draw(cameras[row], motion, row)
            mask = disturb_mask(mask, config.mask_noise_px, smudges)
            write_png(folder / "images" / name, rgb)
            write_png(folder / masks / name, np.repeat(np.where(mask, 255, 0).astype(np.uint8)[..., None], 3, axis=2))
            heard(row + 1)
        pose, root = disturb_poses(motion, config, rng)
        footage = Footage(
            names=names,
            images=tuple(folder / "images" / name for name in names),
            masks=tuple(folder / masks / name for name in names),
            sizes_px=np.tile(np.array([framing.width_px, framing.height_px]), (config.frames, 1)),
            K_px=np.tile(framing.K_px, (config.frames, 1, 1)),
            T_world_camera=cameras,
            root_m=root,
            pose_axis_angle=pose,
        )
        if config.body == "keypoints":
            write_views(folder, footage)
            write_keypoints(folder / KEYPOINTS_FILE, _film_keypoints(avatar, drawer, motion, footage, config), names)
        else:
            (write_neuman if config.layout == "neuman" else write_plain)(folder, footage)
        _write_truth(folder, avatar, motion, cameras, config)


class PersonDrawer:
    """Draws an avatar before the studio's room, or in a scene."""

    def __init__(
        self, avatar: Avatar, framing: Framing, scene: Scene | None = None, *, scene_hides: bool = True
    ) -> None:
        self._avatar, self._framing, self._scene_hides = avatar, framing, scene_hides
        self._in_scene: CpuRasterizer | None = None
        if scene is not None:
            packed = [pack_cloud(cloud) for cloud in (scene.cloud, scene.sky) if cloud is not None]
            self._in_scene = CpuRasterizer(
                packed, {avatar.name: avatar}, framing.K_px, framing.height_px, framing.width_px
            )
        self._rasterizer = CpuRasterizer([], {avatar.name: avatar}, framing.K_px, framing.height_px, framing.width_px)

    def alone(self, T_world_camera: Float64Array, motion: Motion, row: int) -> tuple[Float64Array, Float64Array]:
        """The person alone: colours times alpha in 0..255, shape (H, W, 3), and alpha, shape (H, W)."""
        images = self._rasterizer.render([self._view(T_world_camera, motion, row)], ("alpha",))[0]
        assert images.alpha is not None
        return images.rgb.astype(np.float64), images.alpha.astype(np.float64)

    def depths(self, T_world_camera: Float64Array, motion: Motion, row: int) -> Float32Array:
        """Depth of the person [m], inf beside them, shape (H, W)."""
        images = self._rasterizer.render([self._view(T_world_camera, motion, row)], ("depth",))[0]
        assert images.depth_m is not None
        return images.depth_m

    def draw(self, T_world_camera: Float64Array, motion: Motion, row: int) -> tuple[UInt8Array, BoolArray]:
        """The picture, shape (H, W, 3), and where the person is, shape (H, W)."""
        colours, alpha = self.alone(T_world_camera, motion, row)
        if self._in_scene is not None and self._scene_hides:
            images = self._in_scene.render([self._view(T_world_camera, motion, row)], ("mask",))[0]
            assert images.mask is not None
            # What stands before the person is not in the mask.
            return images.rgb, (alpha > MASK_ALPHA) & (images.mask == 1)
        if self._in_scene is not None:
            around = self._in_scene.render([View(T_world_camera=T_world_camera, humans=())])[0].rgb
            return self._mix(colours, alpha, around.astype(np.float64)), alpha > MASK_ALPHA
        joints = joint_positions(self._avatar, motion)[row]
        feet = np.stack([0.5 * (joints[ankle] + joints[ball]) for ankle, ball in ((7, 10), (8, 11))])
        ground = studio_ground(T_world_camera, self._framing, feet)
        return self._mix(colours, alpha, ground), alpha > MASK_ALPHA

    @staticmethod
    def _mix(colours: Float64Array, alpha: Float64Array, around: Float64Array) -> UInt8Array:
        """A person before something, colours (H, W, 3) in 0..255."""
        mixed = colours + (1.0 - alpha[..., None]) * around
        return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)

    def _view(self, T_world_camera: Float64Array, motion: Motion, row: int) -> View:
        root, pose = motion.root_m[row], motion.pose_axis_angle[row]
        human = PosedHuman(avatar=self._avatar.name, root_m=root, pose_axis_angle=pose)
        return View(T_world_camera=T_world_camera, humans=(human,))


def framing_of(config: AvatarCaptureConfig) -> Framing:
    """The camera of a film."""
    return Framing(
        height_px=config.height_px,
        width_px=config.width_px,
        focal_px=_FOCAL_PER_SIDE * min(config.height_px, config.width_px),
    )


def film_motion(avatar: Avatar, config: AvatarCaptureConfig) -> Motion:
    """What the person does: exactly `config.frames` rows over the floor z = 0."""
    if config.motion == "turn":
        return _turning(avatar, config)
    angle = np.linspace(0.0, 2 * math.pi * max(1.0, config.frames / 100), 400)
    # `level_walk` has floor from x = 0 to 11 m.
    radius_m = config.walk_radius_m
    way = np.stack([_MIDDLE_X_M + radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle))], axis=1)
    whole = level_walk(avatar, way, _SPEED_MPS, seed=config.seed)
    rows = np.minimum(np.arange(config.frames), len(whole.root_m) - 1)
    return Motion(root_m=whole.root_m[rows], pose_axis_angle=whole.pose_axis_angle[rows])


def _turning(avatar: Avatar, config: AvatarCaptureConfig) -> Motion:
    """Once around on the spot, arms away from the body, which sway a little."""
    phase = 2 * math.pi * np.arange(config.frames) / config.frames
    pose = np.zeros((config.frames, 24, 3))
    swing = 0.12 * np.sin(3.0 * phase)
    pose[:, 16, 2], pose[:, 17, 2] = -_ARMS_RAD + swing, _ARMS_RAD + swing
    pose[:, 18, 1], pose[:, 19, 1] = -0.25, 0.25
    pose[:, 1, 2], pose[:, 2, 2] = 0.08, -0.08
    pose[:, 0, 1] = (phase + math.pi) % (2 * math.pi) - math.pi
    root = np.tile([_MIDDLE_X_M, config.walk_radius_m, 0.0], (config.frames, 1))
    still = Motion(root_m=root.astype(np.float32), pose_axis_angle=pose.astype(np.float32))
    low = joint_positions(avatar, still)[:, [7, 8], 2].min(axis=1)
    root[:, 2] = avatar.joints_tpose_m[[7, 8], 1].mean() - low
    return Motion(root_m=root.astype(np.float32), pose_axis_angle=still.pose_axis_angle)


def _cameras(avatar: Avatar, motion: Motion, config: AvatarCaptureConfig, rng: np.random.Generator) -> Float64Array:
    """Poses of a camera held by hand that follows the person, shape (F, 4, 4)."""
    count = len(motion.root_m)
    times_s = np.arange(count) / FPS
    phases, periods_s = rng.uniform(0.0, 2 * math.pi, 3), np.array([3.1, 4.3, 2.3])
    sway = _SWAY_M * np.sin(2 * math.pi * times_s[:, None] / periods_s + phases)
    eye = np.array([_MIDDLE_X_M, config.walk_radius_m - _DISTANCE_M, _HEIGHT_M]) + sway
    # The head of someone who walks towards the camera stays in view: it looks at the middle of the body, a bit late.
    target = motion.root_m.astype(np.float64)
    late = np.stack([np.convolve(np.pad(target[:, k], 3, mode="edge"), np.ones(7) / 7, "valid") for k in range(3)], 1)
    late[:, 2] = 0.5 * avatar.height_m
    return np.stack([look_at(a, b) for a, b in zip(eye, late, strict=True)])


def _moved_motion(motion: Motion, T: Float64Array) -> Motion:
    """A motion over the floor, moved by a turn about z and a shift."""
    yaw = math.atan2(T[1, 0], T[0, 0])
    pose = motion.pose_axis_angle.astype(np.float64)
    # SMPL's y is up.
    pose[:, 0] = axis_angle_from_matrix(matrix_from_axis_angle((0.0, yaw, 0.0)) @ matrix_from_axis_angle(pose[:, 0]))
    root = motion.root_m @ T[:3, :3].T + T[:3, 3]
    return Motion(root_m=root.astype(np.float32), pose_axis_angle=pose.astype(np.float32))


def disturb_mask(mask: BoolArray, noise_px: float, rng: np.random.Generator) -> BoolArray:
    """A mask as a network might give it: its border lies inside or outside of the true one, in dents and bumps."""
    if noise_px == 0.0:
        return mask
    inside, outside = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for part in (mask, ~mask)
    )
    size = max(1.0, _BLOB_PX * min(mask.shape))
    field = cv2.GaussianBlur(rng.standard_normal(mask.shape), (0, 0), size)
    return np.asarray(inside - outside + noise_px * field / field.std() > 0.5)


def disturb_poses(
    motion: Motion, config: AvatarCaptureConfig, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Poses and pelvises as an estimator might give them: separate errors for each joint and frame."""
    R = matrix_from_axis_angle(motion.pose_axis_angle)
    sigma_rad = math.radians(config.pose_noise_deg)
    noise = matrix_from_axis_angle(sigma_rad * rng.standard_normal(motion.pose_axis_angle.shape))
    root = motion.root_m + config.pose_noise_m * rng.standard_normal(motion.root_m.shape)
    return axis_angle_from_matrix(R @ noise), root


def _film_keypoints(
    avatar: Avatar, drawer: PersonDrawer, motion: Motion, footage: Footage, config: AvatarCaptureConfig
) -> Keypoints:
    """Keypoints with errors that depend on the seed and on nothing else that is drawn at random."""
    points, rng = keypoints_in_world(avatar, motion), np.random.Generator(np.random.Philox([config.seed, 1]))
    seen = [
        project_keypoints(points[row], T, footage.K_px[row], drawer.depths(T, motion, row))
        for row, T in enumerate(footage.T_world_camera)
    ]
    uv, confidence = (np.stack(parts) for parts in zip(*seen, strict=True))
    return disturb_keypoints(uv, confidence, config.keypoint_noise_px, rng)


def _write_truth(
    folder: Path, avatar: Avatar, motion: Motion, cameras: Float64Array, config: AvatarCaptureConfig
) -> None:
    np.savez(
        folder / TRUTH_ARRAYS,
        allow_pickle=False,
        T_world_camera=cameras,
        root_m=motion.root_m,
        pose_axis_angle=motion.pose_axis_angle,
        joints_m=joint_positions(avatar, motion),
    )
    facts = {
        "format": TRUTH_FORMAT,
        "avatar": avatar.name,
        "avatar_hash": avatar_hash(avatar),
        "license": avatar.license,
        "motion": config.motion,
        "frames": config.frames,
        "size_px": [config.width_px, config.height_px],
        "focal_px": framing_of(config).focal_px,
        "body": config.body,
        "keypoint_noise_px": config.keypoint_noise_px,
        "mask_noise_px": config.mask_noise_px,
        "pose_noise_deg": config.pose_noise_deg,
        "pose_noise_m": config.pose_noise_m,
        "seed": config.seed,
    }
    write_whole(folder / TRUTH_FILE, json.dumps(facts, indent=1) + "\n", raises=AvatarError)
