import dataclasses

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.bound import BLEND_OPS, COLOUR_OPS, LANES, PROJECT_OPS, SKIN_OPS, bound_ms
from readygo.benchmarks.rasterizer.setting import Setting


def test_bound_follows_from_the_work_and_the_peak(setting: Setting) -> None:
    joints = np.mean([(avatar.lbs_weight > 0).sum(axis=1).mean() for avatar in setting.avatars])
    work = {"drawn": 1600.0, "drawn_people": 160.0, "block_entries": 1000.0}
    stages = bound_ms(work, setting, 16, 1e6)
    assert stages["blend"] == pytest.approx(1000 * BLEND_OPS / 1e3)
    assert stages["project_scene"] == pytest.approx(1440 / LANES * (PROJECT_OPS + COLOUR_OPS[16]) / 1e3)
    assert stages["pose_and_project_people"] == pytest.approx(160 / LANES * (PROJECT_OPS + SKIN_OPS * joints) / 1e3)


def test_bound_without_humans_has_nothing_to_pose(setting: Setting) -> None:
    alone = dataclasses.replace(setting, avatars=[])
    stages = bound_ms({"drawn": 16.0, "drawn_people": 0.0, "block_entries": 0.0}, alone, 1, 1e6)
    assert stages["pose_and_project_people"] == stages["blend"] == 0.0
    assert stages["project_scene"] == pytest.approx(PROJECT_OPS / 1e3)
