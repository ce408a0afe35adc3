"""Which robots a policy knows."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from readygo.common.errors import PolicyError
from readygo.common.robot.config import RobotConfig
from readygo.common.robot.ranges import OF_CAMERA, RobotRanges

RANGED = tuple(entry.name for entry in dataclasses.fields(RobotRanges))
"""All that may have a range."""
OF_BODY = tuple(name for name in RANGED if name not in OF_CAMERA)
"""What is not of the camera."""


def known_as(trained: RobotConfig, robot: RobotConfig, names: Sequence[str]) -> RobotConfig:
    """The robot of a policy, with the values of another one that lie in the policy's ranges.

    What else differs is for who asks to judge.

    Args:
        trained: The policy's, with its ranges.
        robot: The robot to drive: one robot, or several, described by their ranges.
        names: Ranges that are looked at.

    Raises:
        PolicyError: If a value is outside of its range.
    """
    outside: list[str] = []
    body: dict[str, Any] = {}
    camera: dict[str, Any] = {}
    for name in names:
        ends, asked = getattr(trained.ranges, name), getattr(robot.ranges, name)
        if not ends and not asked:
            continue
        own, value = (getattr(one.camera if name in OF_CAMERA else one, name) for one in (trained, robot))
        ends, asked = ends or (own, own), asked or (value, value)
        if None in (*ends, *asked) or not ends[0] <= asked[0] <= asked[1] <= ends[1]:
            outside.append(f"{name} {_plain(asked)} (the policy's: {_plain(ends)})")
        (camera if name in OF_CAMERA else body)[name] = value
        if name == "radius_m":
            body["planning_radius_m"] = robot.planning_radius_m
        if name == "v_max_mps" and value:
            backwards = trained.v_min_mps / trained.v_max_mps * value
            body["v_min_mps"] = robot.v_min_mps if math.isclose(backwards, robot.v_min_mps) else backwards
    if outside:
        raise PolicyError(f"The policy was trained for robots of other ranges: {', '.join(outside)}.")
    if not trained.ranges.varies:
        return trained
    seen = dataclasses.replace(trained.camera, **camera)
    return dataclasses.replace(trained, **body, camera=seen, ranges=robot.ranges)


def _plain(ends: Sequence[Any]) -> str:
    numbers = ["none" if end is None else f"{end:g}" for end in ends]
    return numbers[0] if numbers[0] == numbers[-1] else f"{numbers[0]} to {numbers[-1]}"
