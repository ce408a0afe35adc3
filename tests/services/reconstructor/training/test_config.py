"""Settings of a training."""

import pytest

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.services.reconstructor.training.config import GaussiansConfig, preset, weak_texture


@pytest.mark.parametrize("name", ["draft", "standard", "high"])
def test_presets_travel_as_mappings(name: str) -> None:
    settings = preset(name)  # type: ignore[arg-type]
    assert section_from_mapping(GaussiansConfig, section_to_mapping(settings)) == settings


def test_larger_presets_take_more_steps_and_gaussians() -> None:
    sizes = [(preset(name).steps, preset(name).density.count_max) for name in ("draft", "standard", "high")]
    assert sizes == sorted(sizes)


def test_presets_search_for_what_moved_and_single_trainings_do_not() -> None:
    assert all(preset(name).transients for name in ("draft", "standard", "high"))
    assert not GaussiansConfig().transients


def test_bare_walls_are_not_split_for_absolute_gradients() -> None:
    density = weak_texture(preset("standard")).density
    assert not density.needs_absolute
    assert (density.gradient_min, density.opacity_min) == (2e-4, 0.05)


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="steps must be at least 1"):
        GaussiansConfig(steps=0)
    with pytest.raises(ValueError, match="nothing would be left"):
        GaussiansConfig(hold_out=1)
