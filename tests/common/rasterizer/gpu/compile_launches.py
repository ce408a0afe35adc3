"""Compiles every kernel that a pipeline launches for a Hopper GPU, without having one: prints a line per kernel.

Run as a program, without TRITON_INTERPRET: Triton decides at import whether kernels are compiled or interpreted.
"""

import sys
from typing import Any

import numpy as np
import torch
import triton
from triton.backends.compiler import GPUTarget
from triton.compiler import ASTSource

from readygo.common.avatars import load_avatars
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.gpu.batch import ViewBatch
from readygo.common.rasterizer.gpu.device_clouds import upload
from readygo.common.rasterizer.gpu.triton import pipeline as triton_pipeline
from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

KERNELS = ("cull_scene", "cull_humans", "select_chunks", "list_pairs", "project", "bin_entries", "sort_lists", "blend")
OPTIONS = ("num_warps", "enable_fp_fusion")
TYPES = {
    torch.float16: "*fp16",
    torch.float32: "*fp32",
    torch.float64: "*fp64",
    torch.uint8: "*u8",
    torch.int32: "*i32",
    torch.int64: "*i64",
}


class Recorder:
    """Stands in for a kernel, and compiles what it is launched with."""

    def __init__(self, kernel: Any, seen: set[str]) -> None:
        self.kernel, self.seen = kernel, seen

    def __getitem__(self, grid: tuple[int, ...]) -> Any:
        return self.launch

    def launch(self, *args: Any, **named: Any) -> None:
        options = {name: named.pop(name) for name in OPTIONS if name in named}
        names = self.kernel.arg_names
        values = dict(zip(names, args, strict=False)) | named
        signature = {name: type_of(values[name], name in named) for name in names}
        key = f"{self.kernel.__name__} {named} {options}"
        if key in self.seen:
            return
        self.seen.add(key)
        aligned = {(k,): [["tt.divisibility", 16]] for k, name in enumerate(names) if signature[name][0] == "*"}
        source = ASTSource(self.kernel, signature, named, aligned)
        compiled = triton.compile(source, target=GPUTarget("cuda", 90, 32), options=options)
        sys.stdout.write(f"{key}: {len(compiled.asm['cubin'])} bytes, {compiled.metadata.shared} bytes shared\n")


def type_of(value: Any, constant: bool) -> str:
    """The type of an argument in Triton's words."""
    if constant:
        return "constexpr"
    if isinstance(value, torch.Tensor):
        return TYPES[value.dtype]
    return "fp32" if isinstance(value, float) else "i32" if abs(value) < 2**31 else "i64"


def main() -> None:
    """Record and compile the launches of a batch, with colours only and with all images."""
    seen: set[str] = set()
    for name in KERNELS:
        setattr(triton_pipeline, name, Recorder(getattr(triton_pipeline, name), seen))
    rng = np.random.default_rng(0)
    cloud = GaussianCloud(
        means_m=rng.normal(size=(300, 3)).astype(np.float32),
        quats_wxyz=rng.normal(size=(300, 4)).astype(np.float32),
        scales_m=np.full((300, 3), 0.1, dtype=np.float32),
        opacities=np.full(300, 0.5, dtype=np.float32),
        sh=rng.normal(size=(300, 16, 3)).astype(np.float32),
    )
    avatars = list(load_avatars().values())[:1]
    K = np.array([[107.0, 0.0, 128.0], [0.0, 107.0, 72.0], [0.0, 0.0, 1.0]])
    device = torch.device("cpu")
    batch = ViewBatch(
        T_world_camera=torch.eye(4, dtype=torch.float64)[None],
        avatar=torch.zeros((1, 1), dtype=torch.int32),
        root_m=torch.zeros((1, 1, 3), dtype=torch.float64),
        pose_axis_angle=torch.zeros((1, 1, 24, 3), dtype=torch.float64),
        light=torch.ones((1, 1, 3, 4, 4), dtype=torch.float64),
    )
    pipeline = triton_pipeline.TritonPipeline(upload([cloud], avatars, device), K, 144, 256, TritonSettings(), device)
    for depth, normals, planes in ((False, False, 4), (True, True, 10)):
        pipeline.attempt(batch, torch.empty((1, planes, 144, 256)), depth, normals)


if __name__ == "__main__":
    main()
