import numpy as np
import pytest

from readygo.benchmarks.motion import gait_curves as source
from readygo.benchmarks.motion.cmu import RATE_HZ, read_clip
from readygo.benchmarks.motion.mocap import leg_curves_deg


def test_mocap_is_read_as_its_statistics_say(mocap):
    joints, _ = read_clip(mocap, "02_01")
    hip, knee = leg_curves_deg(source.load_clip(mocap, "02_01").joints_m, RATE_HZ, np.eye(3)[2], np.eye(3)[1])
    assert np.ptp(joints[:, 0, 2]) / (len(joints) / RATE_HZ) == pytest.approx(1.18, abs=0.03)
    assert (hip.min(), hip.max()) == pytest.approx((-17.6, 31.3), abs=2.0)
    assert (knee.min(), knee.max()) == pytest.approx((9.7, 72.8), abs=2.0)
