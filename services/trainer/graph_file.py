"""A torch module as an ONNX file."""

import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

OPSET = 17


def graph_bytes(
    module: nn.Module,
    examples: Sequence[Tensor],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    free: Mapping[str, Mapping[int, str]] | None = None,
) -> bytes:
    """The ONNX file of a module; it depends on nothing but the weights.

    Args:
        module: In evaluation mode.
        examples: An example of each input.
        inputs: Names of the inputs.
        outputs: Names of the outputs.
        free: Names of the axes whose size may change, by input or output and axis.
    """
    with warnings.catch_warnings(), torch.no_grad(), tempfile.TemporaryDirectory() as folder:
        # The exporter by tracing is ten times faster than its successor, which matters where a run publishes often.
        warnings.simplefilter("ignore")
        path = Path(folder) / "graph.onnx"
        torch.onnx.export(
            module,
            tuple(examples),
            path,
            input_names=list(inputs),
            output_names=list(outputs),
            dynamic_axes={name: dict(axes) for name, axes in (free or {}).items()},
            opset_version=OPSET,
            dynamo=False,
        )
        return path.read_bytes()
