import numpy as np
import pytest

from readygo.apps.avatar.sheet import phase_rows
from readygo.common.errors import AvatarError


def test_phases_are_quarters_of_a_stride() -> None:
    t = np.arange(120)
    joints = np.zeros((120, 24, 3))
    joints[:, 0, 0] = 0.06 * t
    joints[:, 7, 0] = 0.06 * t + 0.3 * np.cos(2 * np.pi * (t - 8) / 20)
    first, *others = phase_rows(joints)
    assert first % 20 == 8
    assert [row - first for row in others] == [5, 10, 15]
    with pytest.raises(AvatarError, match="no whole stride"):
        phase_rows(joints[:20])
