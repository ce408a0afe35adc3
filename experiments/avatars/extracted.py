"""An extracted avatar beside the one that was filmed: joints, and images in held-out and in new poses.

readygo avatar capture AVATAR.npz --frames 90 --out out/film
readygo avatar extract out/film --out out/person.npz --name person
python -m experiments.avatars.extracted AVATAR.npz out/film out/person.npz [--json] [--sheet FILE.png]

PSNR is taken over the true mask's pixels, of both people before the same grey. Held-out frames are drawn in the poses
that the extraction found, as their errors are those of the film; new poses are the true ones of the motion.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from readygo.apps.avatar.capture import TRUTH_ARRAYS, TRUTH_FILE, AvatarCaptureConfig, PersonDrawer, film_motion
from readygo.apps.avatar.studio import Framing, look_at
from readygo.apps.avatar.walking import level_walk
from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.avatars import POSES_ENDING, Avatar, load_avatar
from readygo.common.drawing.files import write_png
from readygo.common.messages import Motion
from readygo.services.reconstructor import AvatarFitConfig
from readygo.services.reconstructor.training.photos import split_views

GREY = 127.5
VIEWS = 12
FRAMING = Framing(height_px=512, width_px=512, focal_px=768.0)
_DISTANCE_M, _HEIGHT_M = 3.6, 1.35
_ARMS = (16, 17, 18, 19)


def measured(truth: Avatar, film: Path, extracted: Avatar, poses: Path) -> tuple[dict[str, Any], list[UInt8Array]]:
    """Errors of an extraction, and pictures: a row per motion of true and extracted people in turn."""
    true, found = np.load(film / TRUTH_ARRAYS), np.load(poses)
    errors_m = np.linalg.norm(found["joints_m"] - true["joints_m"], axis=2)
    held = list(split_views(range(len(errors_m)), AvatarFitConfig().hold_out)[1])
    facts = json.loads((film / TRUTH_FILE).read_text(encoding="utf-8"))
    width, height = facts["size_px"]
    framing = Framing(height_px=height, width_px=width, focal_px=facts["focal_px"])
    scores = [
        score
        for score, _ in _compare(
            truth,
            extracted,
            framing,
            true["T_world_camera"][held],
            Motion(root_m=true["root_m"][held], pose_axis_angle=true["pose_axis_angle"][held]),
            Motion(root_m=found["root_m"][held], pose_axis_angle=found["pose_axis_angle"][held]),
        )
    ]
    row: dict[str, Any] = {
        "joint_error_cm": round(100 * float(errors_m.mean()), 2),
        "joint_error_p90_cm": round(100 * float(np.quantile(errors_m, 0.9)), 2),
        "held_out_psnr_db": round(float(np.mean(scores)), 2),
        "height_error_cm": round(100 * (extracted.height_m - truth.height_m), 2),
        "gaussians": len(extracted.cloud),
    }
    sheets = []
    for name, motion in new_motions(truth).items():
        rows = np.linspace(0, len(motion.root_m) - 1, VIEWS).astype(int)
        chosen = Motion(root_m=motion.root_m[rows], pose_axis_angle=motion.pose_axis_angle[rows])
        pairs = _compare(truth, extracted, FRAMING, _around(chosen, truth), chosen, chosen)
        row[f"{name}_psnr_db"] = round(float(np.mean([score for score, _ in pairs])), 2)
        sheets.append(np.concatenate([picture for _, picture in pairs[:: VIEWS // 6]], axis=1))
    row["new_poses_psnr_db"] = round(float(np.mean([row[f"{name}_psnr_db"] for name in new_motions(truth)])), 2)
    return row, sheets


def new_motions(avatar: Avatar) -> dict[str, Motion]:
    """Motions that no film of `avatar capture` with seed 0 shows."""
    straight = np.stack([np.linspace(0.0, 5.0, 200), np.zeros(200)], axis=1)
    walk = level_walk(avatar, straight, 1.2, seed=7)
    fast = level_walk(avatar, straight, 2.2, seed=8)
    turn = film_motion(avatar, AvatarCaptureConfig(motion="turn", frames=40))
    arms = turn.pose_axis_angle.copy()
    swing = np.linspace(-1.0, 1.0, len(arms))
    arms[:, _ARMS[0], 2], arms[:, _ARMS[1], 2] = 0.5 * swing, -0.5 * swing
    arms[:, _ARMS[2], 1], arms[:, _ARMS[3], 1] = -0.6 - 0.5 * swing, 0.6 - 0.5 * swing
    return {
        "walk": walk,
        "fast": fast,
        "turn": turn,
        "arms": Motion(root_m=turn.root_m, pose_axis_angle=arms.astype(np.float32)),
    }


def _around(motion: Motion, avatar: Avatar) -> Float64Array:
    """Cameras on a circle around the person, one for each row; they go the other way than people who turn."""
    poses = []
    for row, root in enumerate(motion.root_m):
        angle = -2 * np.pi * row / len(motion.root_m)
        x, y = (root[:2] + _DISTANCE_M * np.array([np.cos(angle), np.sin(angle)])).tolist()
        poses.append(look_at((x, y, _HEIGHT_M), (root[0], root[1], 0.5 * avatar.height_m)))
    return np.stack(poses)


def _compare(
    truth: Avatar, extracted: Avatar, framing: Framing, cameras: Float64Array, true: Motion, found: Motion
) -> list[tuple[float, UInt8Array]]:
    """PSNR in the true mask, and both people side by side, for each row."""
    drawers = PersonDrawer(truth, framing), PersonDrawer(extracted, framing)
    out = []
    for row, T in enumerate(cameras):
        images = []
        for drawer, motion in zip(drawers, (true, found), strict=True):
            colours, alpha = drawer.alone(T, motion, row)
            images.append((colours + GREY * (1.0 - alpha[..., None]), alpha))
        inside = images[0][1] > 0.5
        error = float(np.mean((images[0][0] - images[1][0])[inside] ** 2)) / 255.0**2
        middle = slice(framing.width_px // 4, 3 * framing.width_px // 4)
        both = np.concatenate([image[:, middle] for image, _ in images], axis=1)
        out.append((-10.0 * np.log10(max(error, 1e-12)), np.clip(both + 0.5, 0, 255).astype(np.uint8)))
    return out


def main() -> None:
    """Print one row of errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("avatar", type=Path)
    parser.add_argument("film", type=Path)
    parser.add_argument("extracted", type=Path)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--sheet", type=Path)
    options = parser.parse_args()
    extracted = load_avatar(options.extracted)
    row, sheets = measured(
        load_avatar(options.avatar), options.film, extracted, options.extracted.with_suffix(POSES_ENDING)
    )
    if options.sheet:
        write_png(options.sheet, np.concatenate(sheets))
    text = json.dumps(row) if options.json else "\n".join(f"{name:24} {value}" for name, value in row.items())
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
