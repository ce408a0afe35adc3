import pytest

from tests.common.rasterizer.drawing import numbered


@pytest.fixture(scope="module")
def rasterizer(triton_device: str):
    """Makes rasterizers with settings that suit the interpreter: few tiles, few slabs, short runs."""
    from readygo.common.rasterizer.gpu.rasterizer import GpuRasterizer
    from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

    def make(scenes, avatars, K, height: int, width: int, **settings):
        chosen = {
            "tile_height_px": 16,
            "slab_shares": (0.4,),
            "sort_run": 64,
            "long_sort_run": 64,
            "programs_per_processor": 1,
            **settings,
        }
        return GpuRasterizer(
            scenes,
            numbered(avatars),
            K,
            height,
            width,
            kernels="triton",
            device=triton_device,
            settings=TritonSettings(**chosen),
        )

    return make
