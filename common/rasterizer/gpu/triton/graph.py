"""One pass of the Triton pipeline as a CUDA graph: its some 60 launches cost the host one call."""

from typing import Any

import torch
from torch import Tensor

from readygo.common.rasterizer.gpu.batch import ViewBatch
from readygo.common.rasterizer.gpu.triton.pipeline import TritonPipeline

Shape = tuple[int, int, bool, bool]


class GraphedPass:
    """Captures a pipeline's pass once per shape of batch, and replays it.

    Batches of more than `most_cameras` go through the pipeline, whose launches then overlap with long kernels.

    Args:
        pipeline: What to capture; on a CUDA device.
        most_cameras: Cameras of one pass.
    """

    def __init__(self, pipeline: TritonPipeline, most_cameras: int) -> None:
        self._pipeline, self._most = pipeline, most_cameras
        self._captured: dict[Shape, tuple[ViewBatch, Tensor, Any, int]] = {}

    def draw(self, batch: ViewBatch, *, depth: bool = False, normals: bool = False) -> Tensor:
        """Image planes, as `TritonPipeline.draw`; the next call with a batch of this shape overwrites them."""
        cameras, human_count = batch.avatar.shape
        if not 0 < cameras <= self._most:
            return self._pipeline.draw(batch, depth=depth, normals=normals)
        shape = (cameras, human_count, depth, normals)
        while True:
            held = self._captured.get(shape)
            if held is None or held[3] != self._pipeline.buffers_made:
                held = self._captured[shape] = self._capture(batch, depth, normals)
            inputs, planes, graph, _ = held
            _copy(batch, inputs)
            self._pipeline.begin()
            graph.replay()
            if self._pipeline.check_capacity(normals):
                return planes

    def _capture(self, batch: ViewBatch, depth: bool, normals: bool) -> tuple[ViewBatch, Tensor, Any, int]:
        # The first pass compiles kernels and grows buffers, which a capture must not do.
        planes = self._pipeline.draw(batch, depth=depth, normals=normals)
        inputs = ViewBatch(
            T_world_camera=batch.T_world_camera.clone(),
            avatar=batch.avatar.clone(),
            root_m=batch.root_m.clone(),
            pose_axis_angle=batch.pose_axis_angle.clone(),
            light=batch.light.clone(),
        )
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._pipeline.attempt(inputs, planes, depth, normals)
        return inputs, planes, graph, self._pipeline.buffers_made


def _copy(source: ViewBatch, target: ViewBatch) -> None:
    target.T_world_camera.copy_(source.T_world_camera)
    target.avatar.copy_(source.avatar)
    target.root_m.copy_(source.root_m)
    target.pose_axis_angle.copy_(source.pose_axis_angle)
    target.light.copy_(source.light)
