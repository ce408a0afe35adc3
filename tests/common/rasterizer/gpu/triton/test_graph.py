from contextlib import contextmanager

import numpy as np
import pytest

from readygo.common.rasterizer.interface import PosedHuman
from tests.common.rasterizer.drawing import batch_of

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.rasterizer.gpu.batch import make_batch  # noqa: E402


class CountingPipeline:
    """Writes each camera's x to its planes, and needs larger buffers from a number of cameras on."""

    def __init__(self) -> None:
        self.buffers_made, self.drawn, self.tight = 1, 0, False

    def draw(self, batch, *, depth: bool, normals: bool):
        self.drawn += 1
        planes = torch.empty((len(batch.avatar), 1, 1, 1))
        self.attempt(batch, planes, depth, normals)
        self.tight = False
        return planes

    def begin(self) -> None:
        pass

    def attempt(self, batch, planes, depth: bool, normals: bool) -> None:
        planes[:] = batch.T_world_camera[:, 0, 3].float()[:, None, None, None]

    def check_capacity(self, normals: bool) -> bool:
        fits, self.tight = not self.tight, False
        self.buffers_made += not fits
        return fits


@pytest.fixture
def graphed(triton_device: str, monkeypatch: pytest.MonkeyPatch):
    """A graphed pass over a counting pipeline; capturing keeps the arguments, replaying calls with them again."""
    from readygo.common.rasterizer.gpu.triton.graph import GraphedPass

    pipeline = CountingPipeline()
    captured: list[object] = []

    class Graph:
        def replay(self) -> None:
            CountingPipeline.attempt(pipeline, *self.arguments)

    @contextmanager
    def capture(graph):
        def keep(*arguments) -> None:
            graph.arguments = arguments

        captured.append(graph)
        pipeline.attempt = keep
        yield
        del pipeline.attempt

    monkeypatch.setattr(torch.cuda, "CUDAGraph", Graph)
    monkeypatch.setattr(torch.cuda, "graph", capture)
    return GraphedPass(pipeline, 2), pipeline, captured


def batch(*x_m: float):
    poses = np.tile(np.eye(4), (len(x_m), 1, 1))
    poses[:, 0, 3] = x_m
    human = PosedHuman(avatar="0", root_m=np.zeros(3), pose_axis_angle=np.zeros((24, 3)))
    return make_batch(batch_of(poses, [[human]] * len(x_m)), {"0": 0}, "cpu")


def test_one_capture_serves_all_batches_of_a_shape(graphed) -> None:
    passes, pipeline, captured = graphed
    for x in (1.0, 2.0, 3.0):
        assert passes.draw(batch(x, x + 10)).flatten().tolist() == [x, x + 10]
    assert passes.draw(batch(7.0)).flatten().tolist() == [7.0]
    assert (len(captured), pipeline.drawn) == (2, 2)


def test_larger_buffers_are_captured_anew(graphed) -> None:
    passes, pipeline, captured = graphed
    passes.draw(batch(1.0))
    pipeline.tight = True
    assert passes.draw(batch(5.0)).flatten().tolist() == [5.0]
    assert len(captured) == 2


def test_batches_of_several_passes_are_not_captured(graphed) -> None:
    passes, pipeline, captured = graphed
    assert passes.draw(batch(1.0, 2.0, 3.0)).flatten().tolist() == [1.0, 2.0, 3.0]
    assert not captured
    assert pipeline.drawn == 1
