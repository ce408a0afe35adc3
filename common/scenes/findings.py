"""What a user should know of a scene that was imported: what looks wrong, how much of it, and what mends it."""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import BoolArray
from readygo.common.camera.captured import CapturedViews
from readygo.common.episode.config import EpisodeConfig
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.defects import FLOATERS, HAZE, HUGE, count_kinds, unwanted_masks
from readygo.common.maps import ScenePlan
from readygo.common.maps.coarse_ground import BLURRED_M
from readygo.common.scenes.survey import ROOM_HEIGHT_M, ROOM_HEIGHTS_M, Survey, UpCandidate, survey

SHARES_WORTH_NAMING = {HUGE: 0.0, FLOATERS: 0.01, HAZE: 0.05}
"""Fewer of them, as a share of all Gaussians, are in every scene."""
CONNECTED_MIN = 0.7
"""Free ground of which less than this part hangs together is in pieces."""
COARSE_SHARE_MIN = 0.02
"""Smaller parts of the free ground that look badly are in every scene."""
ROUGH, BLURRED, UNFILMED = "rough ground that counts as free", "ground of large Gaussians: blurred", "hardly filmed"
TILT_DEG = 3.0
STOREY_M = 1.8
"""A level this high above the floor is another one [m]."""


def findings(
    cloud: GaussianCloud, plan: ScenePlan, report: dict[str, Any], views: CapturedViews | None = None
) -> list[str]:
    """Sentences on what looks wrong in a scene.

    Args:
        cloud: Gaussians, metres, z up.
        plan: Its maps.
        report: Its figures, as of `scene_report`.
        views: The cameras that it was filmed with: they know better than Gaussians which way is up.
    """
    found = survey(cloud)
    held = None if views is None or not len(views) else views.mean_up
    return [
        *_frame(found.clear_up if held is None else found.up_near(held), report["floor"]["tilt_deg"]),
        *_storeys(found),
        *_gaussians(cloud),
        *_ground(plan),
        *_room_to_move(report),
    ]


def marks(plan: ScenePlan) -> dict[str, BoolArray]:
    """The cells that some of the sentences are about, by what is the matter with them, shape (H, W) each."""
    free = ~plan.robot.occupied
    return {ROUGH: plan.phantoms & free, BLURRED: plan.blurred & free & ~plan.coarse, UNFILMED: plan.coarse}


def goals_line(farthest_m: float, goal_distance_min_m: float, radius_m: float) -> str:
    """Why no episode can be drawn, or nothing."""
    if farthest_m >= goal_distance_min_m:
        return ""
    advice = "give more of the place, check the scale, take a smaller robot"
    if farthest_m > 1.5:
        advice += f", or set [episode] goal_distance_min_m below {farthest_m:.1f} (and success_radius_m below that)"
    return (
        f"no episode has room: goals are {goal_distance_min_m:g} m away at least, but a disc of {radius_m:g} m gets no "
        f"farther than {farthest_m:.1f} m; {advice}."
    )


def _frame(clear: UpCandidate | None, floor_tilt_deg: float) -> list[str]:
    """What is wrong with up and scale; a floor is tilted where its Gaussians and the heights of its map say so."""
    if clear is None:
        return []
    if clear.up[2] < 0.7:
        side = "upside down" if clear.up[2] < -0.7 else "on its side"
        return [f"the scene looks {side}: its floor says that {clear.name} is up; import it with --up=auto."]
    sentences = []
    tilt = min(math.degrees(math.acos(min(1.0, float(clear.up[2])))), floor_tilt_deg)
    if tilt > TILT_DEG:
        sentences.append(f"its floor is tilted by {tilt:.0f} deg; `readygo scene align` levels it.")
    if clear.ceiling is not None and not ROOM_HEIGHTS_M[0] <= clear.ceiling <= ROOM_HEIGHTS_M[1]:
        factor = ROOM_HEIGHT_M / clear.ceiling
        sentences.append(
            f"its ceiling is {clear.ceiling:.2f} m above its floor: the scale may be wrong by {factor:.2g}, which "
            "`readygo scene scale --room-height 2.5` mends."
        )
    return sentences


def _storeys(found: Survey) -> list[str]:
    """Another floor above the one that is used."""
    upright = [up for up in found.ups if up.up[2] > 0.95 and up.ceiling is not None]
    if not upright or upright[0].ceiling is None:
        return []
    low, high = upright[0].floor + STOREY_M, upright[0].floor + upright[0].ceiling - STOREY_M
    return [
        f"there may be another floor at about z = {z:.1f} m, out of reach for robots; --crop-z imports it instead."
        for z in upright[0].levels
        if low <= z <= high
    ][-1:]


def _gaussians(cloud: GaussianCloud) -> list[str]:
    masks = {
        kind: mask for kind, mask in unwanted_masks(cloud).items() if float(mask.mean()) > SHARES_WORTH_NAMING[kind]
    }
    if not masks:
        return []
    return [f"it holds unwanted Gaussians ({count_kinds(masks)}); `readygo scene clean` shows and removes them."]


def _ground(plan: ScenePlan) -> list[str]:
    cell_m2 = plan.robot.frame.resolution_m**2
    free = ~plan.robot.occupied
    sentences = []
    phantoms_m2 = float(plan.phantoms.sum()) * cell_m2
    if phantoms_m2 >= 1.0:
        sentences.append(f"{phantoms_m2:.0f} m2 of rough ground would look like obstacles and count as free.")
    free_m2 = float(free.sum()) * cell_m2
    found = marks(plan)
    coarse_m2, blurred_m2 = (float((found[kind] & free).sum()) * cell_m2 for kind in (UNFILMED, BLURRED))
    if coarse_m2 >= max(1.0, COARSE_SHARE_MIN * free_m2):
        sentences.append(
            f"{coarse_m2:.0f} of {free_m2:.0f} m2 of free ground were hardly filmed (huge Gaussians, blur); "
            "--close-coarse keeps everybody off them."
        )
    if blurred_m2 >= max(1.0, COARSE_SHARE_MIN * free_m2):
        sentences.append(
            f"{blurred_m2:.0f} of {free_m2:.0f} m2 of free ground consist of Gaussians above {BLURRED_M:g} m (usual: "
            f"{plan.ground_size_m:.2f} m): a robot's images of it will be blurred."
        )
    return sentences


def _room_to_move(report: dict[str, Any]) -> list[str]:
    robot = report["robot"]
    sentences = []
    free_m2 = float(np.sum(robot["standing_m2"]))
    if robot["reachable_m2"] < CONNECTED_MIN * free_m2:
        sentences.append(
            f"where the robot can stand is in {robot['separate_areas']} pieces: {robot['reachable_m2']:.0f} of "
            f"{free_m2:.0f} m2 hang together."
        )
    line = goals_line(robot["farthest_m"], EpisodeConfig().goal_distance_min_m, robot["radius_m"])
    return [*sentences, line] if line else sentences
