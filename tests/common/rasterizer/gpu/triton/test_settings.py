import pytest

from readygo.common.errors import ReadygoError


@pytest.mark.parametrize(
    "bad", [{"tile_width_px": 12}, {"slab_shares": (0.5, 0.2)}, {"long_sort_run": 48}, {"cameras_per_pass": 0}]
)
def test_bad_settings_are_refused(bad: dict[str, object]) -> None:
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    with pytest.raises(ValueError, match=next(iter(bad))):
        TritonSettings(**bad)


@pytest.mark.parametrize(
    ("size_px", "tile_px", "warps"),
    [
        ((144, 256), (8, 16), 1),
        ((2040, 4080), (8, 16), 1),
        ((2041, 4080), (16, 16), 2),
        ((4095, 4095), (32, 32), 8),
        ((8160, 8160), (32, 32), 8),
    ],
)
def test_large_images_get_larger_tiles_with_as_many_pixels_per_warp(size_px, tile_px, warps: int) -> None:
    from readygo.common.rasterizer.gpu.triton.settings import TILES_MAX, TritonSettings

    fitted = TritonSettings().for_image(*size_px)
    assert (fitted.tile_height_px, fitted.tile_width_px) == tile_px
    assert fitted.blend_warps == warps
    assert all(-(-size // tile) <= TILES_MAX for size, tile in zip(size_px, tile_px, strict=True))


def test_image_that_the_largest_tiles_do_not_cover_is_refused_in_one_line() -> None:
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    with pytest.raises(ReadygoError, match="up to 8160 px a side, got 20x8161 px; use the cpu backend"):
        TritonSettings().for_image(20, 8161)
