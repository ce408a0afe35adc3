"""A contact sheet of an avatar: four phases of the gait, each from three sides."""

import numpy as np
import numpy.typing as npt

from readygo.apps.avatar.film import level_walk
from readygo.apps.avatar.studio import Framing, Studio, look_at
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.drawing.files import Picture
from readygo.common.drawing.plan_view import WHITE, put_text
from readygo.common.errors import AvatarError

Array = npt.NDArray[np.float64]

PHASES = ("left heel strike", "left stance", "right heel strike", "right stance")
"""Gait phases of the columns, a quarter of a stride apart."""
VIEWS = {"front": 0.0, "left side": 0.5 * np.pi, "back": np.pi}
"""Direction from the human to the camera by view: angle [rad] from the walking direction to the left."""
TILE = Framing(height_px=400, width_px=300, focal_px=800.0)
SPEED_MPS, LENGTH_M = 1.2, 9.0
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M = 4.4, 1.3
_CAPTION_PX = 22


def contact_sheet(avatar: Avatar, *, seed: int = 0) -> Picture:
    """The sheet: a row per view, a column per phase of a straight walk at 1.2 m/s.

    Args:
        avatar: Avatar that walks.
        seed: Seed of the human's gait habits.

    Returns:
        RGB image of the sheet.
    """
    way = np.stack([np.linspace(0.0, LENGTH_M, 200), np.zeros(200)], axis=1)
    motion = level_walk(avatar, way, SPEED_MPS, seed=seed)
    joints = joint_positions(avatar, motion)
    rows = phase_rows(joints)
    studio = Studio(avatar, TILE)
    strips = []
    for view, angle in VIEWS.items():
        tiles = []
        for phase, row in zip(PHASES, rows, strict=True):
            x, y = motion.root_m[row, :2].tolist()
            away = CAMERA_DISTANCE_M * np.array([np.cos(angle), np.sin(angle)])
            camera = look_at((x + away[0], y + away[1], CAMERA_HEIGHT_M), (x, y, 0.5 * avatar.height_m))
            tile = studio.picture(camera, motion, row, joints)
            put_text(tile, f"{phase}, {view}", (8, _CAPTION_PX - 6), size=0.4, halo=WHITE)
            tiles.append(tile)
        strips.append(np.concatenate(tiles, axis=1))
    return np.concatenate(strips)


def phase_rows(joints_m: Array) -> tuple[int, int, int, int]:
    """Rows of `PHASES` in the middle stride of a walk along +x.

    A heel strikes where its ankle is furthest ahead of the pelvis.

    Args:
        joints_m: Joint positions [m], shape (T, 24, 3).

    Raises:
        AvatarError: If there is no whole stride.
    """
    ahead = joints_m[:, 7, 0] - joints_m[:, 0, 0]
    peaks = [t for t in range(1, len(ahead) - 1) if ahead[t - 1] < ahead[t] >= ahead[t + 1] and ahead[t] > 0.1]
    if len(peaks) < 2:
        raise AvatarError("The walk has no whole stride to show.")
    middle = (len(peaks) - 1) // 2
    first, stride = peaks[middle], peaks[middle + 1] - peaks[middle]
    return first, first + round(0.25 * stride), first + round(0.5 * stride), first + round(0.75 * stride)
