"""Contact sheets of avatars, to be looked at after a bake: does one take them for dressed people?

    PYTHONPATH=. python deploy/bake/contact_sheet.py common/avatars/data/*.npz --out /tmp/sheets

Per avatar: four phases of a walk from three sides, a stand, a run and spread arms, the head from near, and at
the bottom what the robot's camera sees 2, 3 and 5 m away (each of its pixels drawn 3 x 3).
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

from apps.avatar import standing_pose, write_png
from common.avatars import Avatar, joint_positions, load_avatar
from common.maps import FloorMap, GridFrame
from common.messages import Motion
from common.rasterizer.cpu import CpuRasterizer, PosedPerson
from common.robot import CameraConfig
from services.animator import AnimatorConfig, skeleton_of, walk

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

WALL, FLOOR = np.array([0.80, 0.82, 0.84]), np.array([0.62, 0.61, 0.59])
TILE_HEIGHT_PX, TILE_WIDTH_PX = 720, 440
ROBOT_DISTANCES_M = (2.0, 3.0, 5.0)
MAGNIFIED = 3
# Azimuth [deg] from the front towards the person's left, distance [m], and as shares of the person's height the heights
# of the camera and of what it looks at.
WALK_VIEWS = ((25.0, 5.0, 0.75, 0.5), (90.0, 5.0, 0.7, 0.5), (205.0, 5.0, 0.75, 0.5))


def main() -> None:
    """Draw a sheet per file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("avatars", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, required=True, help="folder for the sheets")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for path in arguments.avatars:
        write_png(arguments.out / f"{path.stem}.png", contact_sheet(load_avatar(path)))


def contact_sheet(avatar: Avatar) -> Image:
    """All views of one avatar, RGB, shape (3 * 720 + 432, 6 * 440, 3)."""
    phases = walk_phases(avatar)
    poses = (standing_pose(), run_pose(), spread_pose())
    heads = (25.0, 90.0, 180.0)
    camera = _Studio(avatar, TILE_HEIGHT_PX, TILE_WIDTH_PX)
    rows = []
    for row, (azimuth_deg, distance_m, *heights) in enumerate(WALK_VIEWS):
        whole = [camera.picture(person, azimuth_deg, distance_m, *heights, span_m=2.05) for person in phases]
        posed = grounded(avatar, poses[row])
        whole.append(camera.picture(posed, (-30.0, 70.0, 0.0)[row], 5.0, 0.7, 0.5, span_m=2.05))
        stand = grounded(avatar, standing_pose())
        top = 0.93 if avatar.height_m > 1.4 else 0.91
        whole.append(camera.picture(stand, heads[row], 1.6, 0.95, top, span_m=0.55))
        rows.append(np.concatenate(whole, axis=1))
    return np.concatenate([*rows, _robot_strip(avatar, phases, rows[0].shape[1])])


def walk_phases(avatar: Avatar) -> list[PosedPerson]:
    """Four moments of one stride at 1.2 m/s, the left foot ahead in the first; at the origin, facing -y."""
    y = -np.arange(0.0, 7.0, 0.06)
    trajectory = np.stack([np.zeros_like(y), y], axis=1)
    frame = GridFrame(origin_x_m=-5.0, origin_y_m=-12.0, resolution_m=1.0)
    floor = FloorMap(frame=frame, height_m=np.zeros((20, 10), dtype=np.float32))
    rng = np.random.Generator(np.random.Philox(0))
    motion = walk(skeleton_of(avatar), trajectory, floor, rng, AnimatorConfig())
    joints = joint_positions(avatar, motion)
    ahead = joints[:, 8, 1] - joints[:, 7, 1]
    high = 0.9 * ahead.max()
    peaks = [k for k in range(30, len(ahead) - 1) if ahead[k - 1] <= ahead[k] > ahead[k + 1] and ahead[k] > high]
    first, following = peaks[0], peaks[1]
    people = []
    for quarter in range(4):
        row = round(first + (following - first) * quarter / 4)
        root = motion.root_m[row] * np.array([0, 0, 1], dtype=np.float32)
        people.append(PosedPerson(avatar=0, root_m=root, pose_axis_angle=motion.pose_axis_angle[row]))
    return people


def run_pose() -> npt.NDArray[np.float32]:
    """Knee at 90 degrees, elbows bent, arms far ahead and behind."""
    pose = np.zeros((24, 3), dtype=np.float32)
    pose[1], pose[2] = (-0.95, 0.0, 0.0), (0.35, 0.0, 0.0)
    pose[4], pose[5] = (1.0, 0.0, 0.0), (1.55, 0.0, 0.0)
    pose[16], pose[17] = (0.35, -0.45, -1.15), (-0.35, -0.45, 1.15)
    pose[18], pose[19] = (0.0, -1.2, 0.0), (0.0, 1.2, 0.0)
    return pose


def spread_pose() -> npt.NDArray[np.float32]:
    """Arms a little below a T."""
    pose = np.zeros((24, 3), dtype=np.float32)
    pose[16], pose[17] = (0.0, 0.0, -0.25), (0.0, 0.0, 0.25)
    return pose


def grounded(avatar: Avatar, pose: npt.NDArray[np.float32]) -> PosedPerson:
    """A person facing -y whose lower ankle is as high above the floor as in a stand."""
    motion = Motion(root_m=np.zeros((1, 3), dtype=np.float32), pose_axis_angle=pose[None])
    ankles_m = joint_positions(avatar, motion)[0, [7, 8], 2]
    root = np.array([0.0, 0.0, avatar.joints_tpose_m[7, 1] - ankles_m.min()], dtype=np.float32)
    return PosedPerson(avatar=0, root_m=root, pose_axis_angle=pose)


class _Studio:
    """Pictures of a person before a plain wall."""

    def __init__(self, avatar: Avatar, height_px: int, width_px: int) -> None:
        self._avatar, self._size = avatar, (height_px, width_px)

    def picture(
        self,
        person: PosedPerson,
        azimuth_deg: float,
        distance_m: float,
        camera_share: float,
        target_share: float,
        *,
        span_m: float,
    ) -> Image:
        """One view whose height at the person is `span_m`; two pixels a side per pixel, averaged."""
        height_px, width_px = (2 * side for side in self._size)
        focal_px = height_px * distance_m / span_m
        K_px = np.array([[focal_px, 0, width_px / 2], [0, focal_px, height_px / 2], [0, 0, 1]])
        height_m = self._avatar.height_m
        T = _looking(azimuth_deg, distance_m, camera_share * height_m, target_share * height_m)
        rgb = drawn(self._avatar, person, T, K_px, height_px, width_px)
        return rgb.reshape(height_px // 2, 2, width_px // 2, 2, 3).mean(axis=(1, 3)).astype(np.uint8)


def drawn(avatar: Avatar, person: PosedPerson, T: Array, K_px: Array, height_px: int, width_px: int) -> Image:
    """The person on a plain floor before a plain wall."""
    images = CpuRasterizer([], [avatar], K_px, height_px, width_px).render_images(T, [person], ("alpha",))
    assert images.alpha is not None
    rows = (np.arange(height_px) + 0.5 - K_px[1, 2]) / K_px[1, 1]
    below = rows * T[2, 1] + T[2, 2] < 0
    ground = np.where(below[:, None, None], FLOOR, WALL) * 255.0
    mixed = images.rgb + (1.0 - images.alpha[:, :, None]) * ground
    return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def _robot_strip(avatar: Avatar, phases: list[PosedPerson], width_px: int) -> Image:
    camera = CameraConfig()
    tiles = []
    for distance_m, person, azimuth_deg in zip(ROBOT_DISTANCES_M, phases, (20.0, 65.0, 160.0), strict=False):
        T = _looking(azimuth_deg, distance_m, camera.mount_height_m, camera.mount_height_m)
        rgb = drawn(avatar, person, T, camera.K_px, camera.height_px, camera.width_px)
        tiles.append(rgb.repeat(MAGNIFIED, axis=0).repeat(MAGNIFIED, axis=1))
    strip = np.concatenate(tiles, axis=1)
    return np.pad(strip, ((0, 0), (0, width_px - strip.shape[1]), (0, 0)), constant_values=255)


def _looking(azimuth_deg: float, distance_m: float, height_m: float, target_m: float) -> Array:
    """A camera around the origin that looks at the height `target_m` above it."""
    azimuth = np.radians(azimuth_deg)
    place = np.array([distance_m * np.sin(azimuth), -distance_m * np.cos(azimuth), height_m])
    forward = np.array([0.0, 0.0, target_m]) - place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = place
    return T


if __name__ == "__main__":
    main()
