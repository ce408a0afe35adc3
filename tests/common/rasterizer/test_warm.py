import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.images.images import OUTPUTS
from readygo.common.rasterizer.cpu import blend, lod_cull, project, view
from readygo.common.rasterizer.cpu import outputs as cpu_outputs
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman
from readygo.common.rasterizer.lod.files import load_or_build_avatar_tree
from readygo.common.rasterizer.lod.tree import ChunkTree
from readygo.common.rasterizer.packed.scene import load_packed, pack_cloud, save_packed
from readygo.common.rasterizer.warm import warm
from tests.common.rasterizer.drawing import images_of, numbered, rgb_of


def signatures() -> dict[str, int]:
    return {
        name: len(function.signatures)
        for module in (blend, lod_cull, cpu_outputs, project, view)
        for name, function in vars(module).items()
        if hasattr(function, "signatures") and hasattr(function, "stats") and not name.startswith("_")
    }


@pytest.mark.parametrize("outputs", [("rgb",), ("depth", "mask"), OUTPUTS])
def test_nothing_is_left_to_compile_after_warming(
    make_cloud, camera, avatar: Avatar, tmp_path, outputs: tuple[str, ...]
) -> None:
    warm(outputs)
    compiled = signatures()
    assert compiled["project_scene"] >= 1
    assert compiled["project_human"] >= 1
    save_packed(pack_cloud(make_cloud(900, coefficients=16), normals=True), tmp_path / "packed")
    mapped = load_packed(tmp_path / "packed")
    assert mapped is not None
    T, K = camera(-4.0, 0.0, 0.0, 256, 144)
    pose = np.zeros((24, 3), dtype=np.float32)
    humans = [PosedHuman(avatar="0", root_m=np.zeros(3, dtype=np.float32), pose_axis_angle=pose)]
    rasterizer = CpuRasterizer([mapped, pack_cloud(make_cloud(90), normals=True)], numbered([avatar]), K, 144, 256)
    rgb_of(rasterizer, T, humans)
    images_of(rasterizer, T, humans, outputs)
    count = mapped.chunk_count
    tree = ChunkTree(scene=mapped, skip=np.arange(1, count + 1), pixel_m=np.zeros(count))
    load_or_build_avatar_tree(tmp_path / "avatar", avatar)
    humans_tree = load_or_build_avatar_tree(tmp_path / "avatar", avatar)
    rgb_of(CpuRasterizer(tree, numbered([avatar]), K, 144, 256, packed_avatars=numbered([humans_tree])), T, humans)
    assert signatures() == compiled
