import pytest

from readygo.common.config import section_to_mapping
from readygo.common.rasterizer.backend_names import GPU_BACKENDS
from readygo.services.renderer import RendererConfig


def test_outputs_have_one_order() -> None:
    config = RendererConfig(outputs=("mask", "rgb", "depth", "mask"))
    assert config.outputs == ("rgb", "depth", "mask")
    assert config == RendererConfig(outputs=("rgb", "depth", "mask"))


@pytest.mark.parametrize("outputs", [(), ("depth",), ("rgb", "thermal"), ("rgb", "")])
def test_outputs_without_rgb_or_with_unknown_names_are_refused(outputs) -> None:
    with pytest.raises(ValueError, match=r"outputs must (hold rgb, got|be of rgb, depth, median_depth, .*, got)"):
        RendererConfig(outputs=outputs)


@pytest.mark.parametrize(
    "wrong",
    [
        {"backend": "cuda"},
        {"detail": "low"},
        {"detail": "lod", "backend": "reference"},
        {"image_format": "gif"},
        {"jpeg_quality": 0},
        {"jpeg_quality": 101},
        {"sub_frames": 1},
        {"sub_frames": 65},
        {"depth": "nearest"},
        {"backend": "gsplat", "outputs": ("rgb", "depth")},
    ],
)
def test_wrong_settings_are_refused(wrong) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        RendererConfig(**wrong)


def test_depth_is_made_of_the_median_unless_the_mean_is_asked_for() -> None:
    kinds = ("rgb", "depth", "median_depth", "mask")
    assert RendererConfig().rasterized(kinds) == ("rgb", "median_depth", "mask")
    assert RendererConfig(depth="mean").rasterized(kinds) == kinds
    assert RendererConfig(backend="gsplat", depth="mean", outputs=("rgb", "depth")).rasterized(("depth",)) == ("depth",)


def test_settings_at_their_limits_are_taken() -> None:
    for quality, frames in ((1, 2), (100, 64)):
        config = RendererConfig(jpeg_quality=quality, sub_frames=frames)
        assert (config.jpeg_quality, config.sub_frames) == (quality, frames)
    assert RendererConfig(contact_shadow=True, backend="reference").contact_shadow
    assert RendererConfig(detail="lod").detail == "lod"


@pytest.mark.parametrize("name", ["contact_shadow", "feet_on_floor"])
def test_what_not_every_backend_draws_is_left_out_there(name: str) -> None:
    on = {name: True}
    assert all(RendererConfig(backend=backend, **on).draws(name) for backend in ("cpu", "reference"))
    assert not any(RendererConfig(backend=backend, **on).draws(name) for backend in GPU_BACKENDS)
    assert not RendererConfig(**{name: False}).draws(name)


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(RendererConfig()) == {
        "backend": "cpu",
        "image_format": "jpeg",
        "jpeg_quality": 90,
        "outputs": ["rgb"],
        "goal_image": False,
        "labels": True,
        "depth": "median",
        "detail": "exact",
        "contact_shadow": False,
        "feet_on_floor": True,
        "human_light": True,
        "human_look": "photoreal",
        "sensor": {
            "k1": [],
            "k2": [],
            "k3": [],
            "k4": [],
            "p1": [],
            "p2": [],
            "exposure_ev": [],
            "red_gain": [],
            "blue_gain": [],
            "vignetting": [],
            "shot_noise": [],
            "read_noise": [],
            "exposure_s": [],
            "readout_s": [],
        },
        "sub_frames": 8,
    }
