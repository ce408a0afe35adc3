"""Which bone is which SMPL joint, by where bones are: for skeletons whose names say nothing."""

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array

_KNEE_SHARE, _ELBOW_SHARE = 0.5, 0.5
"""Knee and elbow are about half way from hip to ankle and from shoulder to wrist."""
_ANKLE_HEIGHT = 0.06
"""Height of the ankle relative to the body."""
_SHOULDER_WIDTH = 0.07
"""Least distance of the shoulder from the middle of the body, relative to the body's height."""


def joints_by_place(heads: Float64Array, parents: Int64Array, height: float) -> dict[str, int]:
    """SMPL joints without those of the spine -> bones, for a human who stands upright with the arms spread.

    The lowest ends of the tree are feet, the most lateral ones hands, the highest is the head; where the two legs meet
    is the pelvis.

    Args:
        heads: Where bones begin, SMPL axes, soles at y = 0, shape (B, 3).
        parents: Bone above each, -1 for none; parents stand before children.
        height: Height of the body, in the unit of `heads`.

    Returns:
        What was found; may be empty.
    """
    ends = np.setdiff1d(np.arange(len(heads)), parents)
    centre = float(np.median(heads[:, 0]))
    lateral = (heads[:, 0] - centre) * 1.0
    low = ends[heads[ends, 1] < 0.2 * height]
    found: dict[str, int] = {}
    feet = _extreme_pair(low, lateral)
    hands = _extreme_pair(ends[heads[ends, 1] > 0.3 * height], lateral)
    if feet is None or hands is None:
        return found
    pelvis = _meeting(*feet, parents)
    chest = _meeting(*hands, parents)
    if pelvis < 0 or chest < 0:
        return found
    found["pelvis"] = pelvis
    for side, foot, hand in zip(("left", "right"), feet, hands, strict=True):
        found |= {f"{side}_{part}": bone for part, bone in _leg(foot, pelvis, heads, parents, height).items()}
        found |= {f"{side}_{part}": bone for part, bone in _arm(hand, chest, heads, parents, height).items()}
    top = int(ends[np.argmax(heads[ends, 1])])
    line = _line(chest, top, parents)
    # The head's own end bones, such as eyes and the crown, are near the top; the joint is where the skull begins.
    skull = [bone for bone in line if heads[bone, 1] > heads[chest, 1] and heads[bone, 1] < 0.93 * height]
    if skull:
        found["head"] = skull[-1]
        if len(skull) > 1:
            found["neck"] = skull[0]
    return found


def _extreme_pair(ends: Int64Array, lateral: Float64Array) -> tuple[int, int] | None:
    """The ends farthest to the left and to the right."""
    if len(ends) < 2:
        return None
    left, right = int(ends[np.argmax(lateral[ends])]), int(ends[np.argmin(lateral[ends])])
    return (left, right) if lateral[left] > 0.0 > lateral[right] else None


def _ancestors(bone: int, parents: Int64Array) -> list[int]:
    line = []
    while bone >= 0:
        line.append(bone)
        bone = int(parents[bone])
    return line


def _meeting(first: int, second: int, parents: Int64Array) -> int:
    others = set(_ancestors(second, parents))
    return next((bone for bone in _ancestors(first, parents) if bone in others), -1)


def _line(start: int, end: int, parents: Int64Array) -> list[int]:
    """Bones from below `start` to `end`, in this order."""
    line = _ancestors(end, parents)
    return line[: line.index(start)][::-1] if start in line else []


def _leg(foot: int, pelvis: int, heads: Float64Array, parents: Int64Array, height: float) -> dict[str, int]:
    line = _line(pelvis, foot, parents)
    if len(line) < 3:
        return {}
    y = heads[line, 1]
    ankle = int(np.argmin(np.abs(y[2:] - _ANKLE_HEIGHT * height))) + 2
    # A hip bone that only leads from the middle of the body to the side is not the thigh.
    hip = 1 if ankle > 2 and abs(heads[line[0], 0] - heads[pelvis, 0]) < 0.02 * height else 0
    middle = y[ankle] + _KNEE_SHARE * (y[hip] - y[ankle])
    knee = int(np.argmin(np.abs(y[hip + 1 : ankle] - middle))) + hip + 1 if ankle > hip + 1 else -1
    if knee < 0:
        return {}
    parts = {"hip": line[hip], "knee": line[knee], "ankle": line[ankle]}
    if ankle + 1 < len(line):
        parts["foot"] = line[ankle + 1]
    return parts


def _arm(hand: int, chest: int, heads: Float64Array, parents: Int64Array, height: float) -> dict[str, int]:
    line = _line(chest, hand, parents)
    outwards = [abs(float(heads[bone, 0] - heads[chest, 0])) for bone in line]
    beyond = [k for k, x in enumerate(outwards) if x > _SHOULDER_WIDTH * height]
    if not beyond or len(line) - beyond[0] < 3:
        return {}
    shoulder = beyond[0]
    reach = _reach(line, shoulder, heads)
    # Fingers branch off at the wrist; without fingers the last bone is the hand.
    children = np.bincount(parents[parents >= 0], minlength=len(heads))
    forks = [k for k in range(shoulder + 2, len(line)) if children[line[k]] >= 2]
    wrist = forks[0] if forks else max(len(line) - 1, shoulder + 2)
    elbow = shoulder + 1 + int(np.argmin(np.abs(reach[1 : wrist - shoulder] - _ELBOW_SHARE * reach[wrist - shoulder])))
    parts = {"shoulder": line[shoulder], "elbow": line[elbow], "wrist": line[wrist]}
    if shoulder > 0:
        parts["collar"] = line[shoulder - 1]
    return parts


def _reach(line: list[int], start: int, heads: Float64Array) -> Float64Array:
    """Length along the bones from the bone `start` on."""
    steps = np.linalg.norm(np.diff(heads[line[start:]], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
