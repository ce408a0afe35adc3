"""Presets and limits of an extraction."""

import pytest

from readygo.services.reconstructor.avatars.config import AvatarFitConfig, PosePriorConfig, avatar_preset


def test_standard_takes_more_of_everything() -> None:
    draft, standard = avatar_preset("draft"), avatar_preset("standard")
    assert draft.steps < standard.steps
    assert draft.side_max_px < standard.side_max_px
    assert 30_000 <= draft.gaussians_max <= standard.gaussians_max <= 90_000


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="hold_out must be 0 or at least 2"):
        AvatarFitConfig(hold_out=1)
    with pytest.raises(ValueError, match="joint_deg"):
        PosePriorConfig(joint_deg=0.0)
