import pytest


@pytest.mark.parametrize(
    "bad", [{"tile_width_px": 12}, {"slab_shares": (0.5, 0.2)}, {"long_sort_run": 48}, {"cameras_per_pass": 0}]
)
def test_bad_settings_are_refused(bad: dict[str, object]) -> None:
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    with pytest.raises(ValueError, match=next(iter(bad))):
        TritonSettings(**bad)
