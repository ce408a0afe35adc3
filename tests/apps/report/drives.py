"""Datasets whose content is known."""

import dataclasses
import math
from pathlib import Path

from readygo.apps.report.coverage_numbers import casts_of, measure
from readygo.common.dataset import Dataset
from tests.common.dataset.episodes import make_episode

COUNT = 20


def drive(index, *, yaw_rad, gaps_m, collision_s=math.inf, visible=0, encounters=("crossing",)):
    """An episode that drives 0.95 m from the origin at 1 m/s; people are seen at the first `visible` samples."""
    changes = {"encounters": encounters, "avatars": ("ann", "bob")[: len(encounters)]}
    header, samples = make_episode(index, COUNT, **changes)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return header, tuple(
        dataclasses.replace(
            sample,
            action_v_mps=1.0,
            action_w_radps=0.0,
            robot_xyzyaw=(0.05 * k * c + 0.01, 0.05 * k * s + 0.01, 0.0, yaw_rad),
            human_distance_m=gaps_m[k % len(gaps_m)],
            time_to_collision_s=collision_s if k == 3 else math.inf,
            human_visible=k < visible,
        )
        for k, sample in enumerate(samples)
    )


def measured(folder: Path):
    dataset = Dataset([folder])
    return measure(dataset, casts_of(dataset))
