"""Weights out of the files that the authors offer, without executing anything in them.

Some of these files hold whole pickled modules of packages that are not installed. Here a name in a file only ever makes
an inert record, and only names are let pass that such modules have; the tensors are then picked out of the records.
"""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn

from readygo.common.errors import DiskError, PolicyError
from readygo.common.files import write_whole
from readygo.common.networks.models import NETWORKS

HARMLESS = (
    "vint_train.",
    "gnm_train.",
    "efficientnet_pytorch.",
    "diffusion_policy.",
    "torchvision.models.",
    "torchvision.ops.",
    "warmup_scheduler.",
    "torch.nn.",
    "torch._C._nn.",
    "torch.optim.",
    "collections.",
    "numpy.",
)
"""Where the classes come from that the authors' files name."""
HOME = "github.com/robodhruv/visualnav-transformer"


class UnloadedObject:
    """Stands in for an object whose class is not loaded."""

    fields: Mapping[str, Any] = {}

    def __init__(self, *_: Any, **__: Any) -> None: ...

    def __setstate__(self, state: Any) -> None:
        self.fields = state if isinstance(state, Mapping) else {}


def load_network(name: str, path: Path) -> nn.Module:
    """A network with the weights of a file.

    Args:
        name: One of `NETWORKS`.
        path: As its authors offer it, or a state dictionary.

    Raises:
        PolicyError: If the file is missing, is damaged, names what no such file has use for, or holds other weights.
    """
    if not path.is_file():
        raise PolicyError(
            f"The method {name} needs its weights: put {path.name} of {HOME} at {path}, "
            f"or train it: readygo train DATA --recipe {name} --out {path.parent}."
        )
    state = {key.removeprefix("module."): value for key, value in _state(_read(path), path).items()}
    network = NETWORKS[name]()
    expected = network.state_dict()
    for key in [*expected, *state]:
        ours, theirs = expected.get(key), state.get(key)
        if ours is None or theirs is None or ours.shape != theirs.shape:
            shapes = ["nothing" if tensor is None else str(tuple(tensor.shape)) for tensor in (theirs, ours)]
            raise PolicyError(f"{path} holds no {name}: {key} is {shapes[0]} there, and should be {shapes[1]}.")
    network.load_state_dict(state)
    return network.eval()


def save_network(network: nn.Module, path: Path) -> None:
    """Write a network's weights as `load_network` reads them: a state dictionary, with the published names.

    Raises:
        DiskError: If they cannot be written; what was there before stays.
    """
    stream = io.BytesIO()
    torch.save(network.state_dict(), stream)
    write_whole(path, stream.getvalue(), raises=DiskError)


def _read(path: Path) -> Any:
    try:
        names = torch.serialization.get_unsafe_globals_in_checkpoint(str(path))
    except Exception as error:  # torch raises many kinds for what is no checkpoint
        raise PolicyError(f"{path} is no checkpoint of torch: {_line(error)}") from error
    strange = sorted(name for name in names if not name.startswith(HARMLESS))
    if strange:
        raise PolicyError(
            f"{path} names {strange[0]}, which no such weights have use for; it is not loaded, because a pickle can "
            "run programs."
        )
    records: list[Any] = [(type("Record", (UnloadedObject,), {}), name) for name in names]
    try:
        with torch.serialization.safe_globals(records):
            return torch.load(str(path), map_location="cpu", weights_only=True)
    except Exception as error:
        raise PolicyError(f"{path} cannot be read: {_line(error)}") from error


def _state(content: Any, path: Path) -> dict[str, torch.Tensor]:
    """Tensors by name: of a module, of a dictionary with one, or of a state dictionary."""
    if isinstance(content, Mapping):
        for key in ("model", "model_state_dict", "state_dict"):
            if key in content:
                return _state(content[key], path)
        if content and all(isinstance(value, torch.Tensor) for value in content.values()):
            return dict(content)
    if isinstance(content, UnloadedObject) and "_modules" in content.fields:
        return dict(_tensors(content, ""))
    raise PolicyError(f"{path} holds neither a module nor a state dictionary, but {type(content).__name__}.")


def _tensors(module: UnloadedObject, where: str) -> list[tuple[str, torch.Tensor]]:
    fields = module.fields
    found = [
        (f"{where}{name}", value.detach())
        for part in ("_parameters", "_buffers")
        for name, value in dict(fields.get(part, {})).items()
        if isinstance(value, torch.Tensor)
    ]
    for name, child in dict(fields.get("_modules", {})).items():
        if isinstance(child, UnloadedObject):
            found += _tensors(child, f"{where}{name}.")
    return found


def _line(error: Exception) -> str:
    return str(error).strip().split("\n")[0][:200] or type(error).__name__
