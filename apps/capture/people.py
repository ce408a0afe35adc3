"""People who walk through a simulated capture: each back and forth on a lane of the ground that is filmed.

A lane is a closed path of two straight sides with half circles at its ends. People keep a distance from the camera and
from each other at all times.
"""

import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from readygo.apps.capture.ground import WalkableGround
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.avatars import Avatar
from readygo.common.errors import SceneError
from readygo.common.maps import FloorMap
from readygo.common.messages import HumanMotion
from readygo.services.animator import skeleton_of, walk

SPEED_MPS, TURN_M = 0.9, 0.4
"""Pace of people, and radius of the half circles [m]."""
LENGTHS_M = (3.0, 2.0, 1.2, 0.6, 0.0)
"""Lengths of a lane's straight sides [m]; longer ones are tried first, and given up where they leave no room."""
CAMERA_M, APART_M = 0.8, 0.7
"""Least distance of a person from the camera, and from other people [m]."""
RATE_HZ = 20
_TRIES, _PHASES = 200, 8
_MARGIN = 0.005
"""Masks reach this share of the image's longer side beyond people, whose edges are soft."""


def plan_people(
    ground: WalkableGround,
    floor: FloorMap,
    camera_xy_m: Float64Array,
    avatars: Mapping[str, Avatar],
    count: int,
    rng: np.random.Generator,
) -> tuple[HumanMotion, ...]:
    """Walks of some people, at 20 Hz.

    Args:
        ground: What is filmed.
        floor: Its height.
        camera_xy_m: Where the camera is at 20 Hz [m], shape (T, 2).
        avatars: By name; people take them in turn.
        count: Number of people.
        rng: Chooses lanes and styles of gait.

    Raises:
        SceneError: If there is no room for so many.
    """
    taken: list[Float64Array] = []
    for first in range(len(LENGTHS_M)):
        taken = max(taken, _free_walks(ground, camera_xy_m, count, LENGTHS_M[first:], rng), key=len)
        if len(taken) == count:
            break
    else:
        raise SceneError(
            f"There is room for {len(taken)} of {count} people beside the camera: film a larger --radius, or "
            "take fewer --people."
        )
    names = sorted(avatars)
    motions = []
    for number, xy_m in enumerate(taken):
        name = names[number % len(names)]
        motion = walk(skeleton_of(avatars[name]), xy_m, floor, rng)
        motions.append(HumanMotion(avatar=name, motion=motion))
    return tuple(motions)


def lane(centre_m: Float64Array, yaw_rad: float, length_m: float) -> Float64Array:
    """A closed lane around a place, a point each 2 cm [m], shape (N, 2)."""
    turn = np.linspace(-0.5 * math.pi, 0.5 * math.pi, max(8, round(math.pi * TURN_M / 0.02)), endpoint=False)
    end = np.column_stack([0.5 * length_m + TURN_M * np.cos(turn), TURN_M * np.sin(turn)])
    side_m = np.arange(0.0, length_m, 0.02)
    side = np.column_stack([0.5 * length_m - side_m, np.full(len(side_m), TURN_M)])
    half = np.concatenate([end, side])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    path: Float64Array = np.concatenate([half, -half]) @ np.array([[c, s], [-s, c]]) + centre_m
    return path


def _free_walks(
    ground: WalkableGround,
    camera_xy_m: Float64Array,
    count: int,
    lengths_m: Sequence[float],
    rng: np.random.Generator,
) -> list[Float64Array]:
    """Where people are over time, shape (T, 2) each [m], of as many as there is room for beside those before them."""
    taken: list[Float64Array] = []
    while len(taken) < count and (xy_m := _free_walk(ground, camera_xy_m, taken, lengths_m, rng)) is not None:
        taken.append(xy_m)
    return taken


def _free_walk(
    ground: WalkableGround,
    camera_xy_m: Float64Array,
    taken: Sequence[Float64Array],
    lengths_m: Sequence[float],
    rng: np.random.Generator,
) -> Float64Array | None:
    """Where a person is over time on the longest lane that is found, shape (T, 2) [m]; None without any."""
    spots = ground.centres_m
    gone_m = SPEED_MPS / RATE_HZ * np.arange(len(camera_xy_m), dtype=np.float64)
    for length_m in lengths_m:
        for _ in range(_TRIES):
            path = lane(spots[rng.integers(len(spots))], float(rng.uniform(0.0, math.pi)), length_m)
            if not ground.holds(path).all():
                continue
            around_m = 2.0 * (length_m + math.pi * TURN_M)
            for phase in range(_PHASES):
                at = np.asarray((gone_m / around_m + phase / _PHASES) % 1.0 * len(path), dtype=np.float64)
                xy_m = _between(path, at)
                if _apart(xy_m, camera_xy_m) >= CAMERA_M and all(_apart(xy_m, other) >= APART_M for other in taken):
                    return xy_m
    return None


def _between(path: Float64Array, at: Float64Array) -> Float64Array:
    """Points of a closed path at places between its points, shape (T, 2)."""
    first = np.floor(at).astype(np.int64) % len(path)
    share = (at - np.floor(at))[:, None]
    return np.asarray((1.0 - share) * path[first] + share * path[(first + 1) % len(path)])


def _apart(one: Float64Array, other: Float64Array) -> float:
    """Least distance of two walks at the same time [m]."""
    return float(np.hypot(*(one - other).T).min())


def people_mask(whose: UInt8Array) -> UInt8Array:
    """A mask as COLMAP has it: 0 where people are and a little around them, else 255.

    Args:
        whose: 0 for the scene, else the number of the person, shape (H, W).
    """
    margin = max(2, round(_MARGIN * max(whose.shape)))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    people = cv2.dilate((whose > 0).astype(np.uint8), kernel)
    return np.where(people > 0, 0, 255).astype(np.uint8)
