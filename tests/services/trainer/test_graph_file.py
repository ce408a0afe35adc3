import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor, nn

from readygo.services.trainer.graph_file import OPSET, graph_bytes


class Sums(nn.Module):
    """Adds a bias to each row, and adds up the rows."""

    def __init__(self) -> None:
        super().__init__()
        self.bias = nn.Parameter(torch.tensor([1.0, 2.0]))

    def forward(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        moved = rows + self.bias
        return moved, moved.sum(dim=0)


def test_file_answers_as_the_module_for_any_size_of_a_free_axis() -> None:
    module = Sums().eval()
    free = {"rows": {0: "count"}, "moved": {0: "count"}}
    data = graph_bytes(module, [torch.zeros(1, 2)], inputs=["rows"], outputs=["moved", "sum"], free=free)
    assert onnx.load_from_string(data).opset_import[0].version == OPSET
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    rows = np.array([[1, 2], [3, 4], [5, 6]], np.float32)
    moved, total = session.run(["moved", "sum"], {"rows": rows})
    assert moved.tolist() == [[2, 4], [4, 6], [6, 8]]
    assert total.tolist() == [12, 18]


def test_file_depends_on_the_weights_alone() -> None:
    files = [graph_bytes(Sums().eval(), [torch.zeros(1, 2)], inputs=["rows"], outputs=["a", "b"]) for _ in range(2)]
    assert files[0] == files[1]
