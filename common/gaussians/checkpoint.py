"""Training checkpoints of gsplat (`ckpt_*.pt`) and of nerfstudio's splatfacto (`step-*.ckpt`).

Both hold what is optimised: means, rotations (w, x, y, z, of any length), logarithms of scales, logits of opacities,
and SH coefficients. gsplat has them below "splats", in one file per process of a training; splatfacto below "pipeline",
in a separate frame, from which `dataparser_transforms.json` leads to the frame of the training's input.

Source: nerfstudio-project/gsplat, `examples/simple_trainer.py`; nerfstudio-project/nerfstudio, `splatfacto.py` and
`save_dataparser_transform` (both Apache-2.0).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.extras import install_command
from readygo.common.files import open_zip
from readygo.common.gaussians.activations import opacities_from_logits, scales_from_logs
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.ply import SH_REST_COUNTS
from readygo.common.gaussians.spherical_harmonics import sh_of_rgb

ZIP_MAGIC = b"PK\x03\x04"
TRANSFORMS_FILE = "dataparser_transforms.json"

_GSPLAT = {"means": "means", "quats": "quats", "scales": "scales", "opacities": "opacities", "dc": "sh0", "rest": "shN"}
_SPLATFACTO = {**_GSPLAT, "dc": "features_dc", "rest": "features_rest"}
_SPLATFACTO_PREFIXES = ("_model.gauss_params.", "_model.")
"""Newest first: splatfacto kept its parameters in the model itself before 2024."""
_JSON_BYTES_MAX = 1 << 20


@dataclass(frozen=True, kw_only=True, eq=False)
class DataTransform:
    """How nerfstudio moved its data for training: x_trained = scale (R x + t)."""

    R: Float64Array
    t: Float64Array
    scale: float


class _Inert:
    """Stands in for NumPy's scalars, which splatfacto's schedulers leave in checkpoints; nothing is made of them."""

    def __init__(self, *_: Any) -> None: ...

    def __setstate__(self, _: Any) -> None: ...


def cloud_from_checkpoint(path: Path) -> tuple[GaussianCloud, bool]:
    """The Gaussians of one file, as they were trained, not validated; and whether it is one of nerfstudio's.

    Raises:
        SceneError: If torch is missing, or the file is damaged, holds anything but tensors and plain values, or no
            Gaussians.
        OSError: If it cannot be read.
    """
    checkpoint = _load(path)
    splats, pipeline = checkpoint.get("splats"), checkpoint.get("pipeline")
    if isinstance(splats, Mapping):
        return _cloud(splats, "", _GSPLAT, path), False
    if isinstance(pipeline, Mapping):
        for prefix in _SPLATFACTO_PREFIXES:
            if f"{prefix}means" in pipeline:
                return _cloud(pipeline, prefix, _SPLATFACTO, path), True
    raise SceneError(
        f"{path} has neither gsplat's 'splats' nor splatfacto's 'pipeline' with Gaussians, only "
        f"{sorted(map(str, checkpoint))[:6]}; import a .ply that the training exported."
    )


def load_data_transform(path: Path) -> DataTransform:
    """Read a `dataparser_transforms.json`.

    Raises:
        SceneError: If it cannot be read, or is no rotation, translation and positive scale.
    """
    try:
        content = read_json(path, bytes_max=_JSON_BYTES_MAX)
        T, scale = np.array(content["transform"], np.float64), float(content["scale"])
        R = T[:3, :3]
        if T.shape not in ((3, 4), (4, 4)) or not np.isfinite(T).all() or not 0 < scale < np.inf:
            raise ValueError("it is no transform with a positive scale")
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
            raise ValueError("its transform does not begin with a rotation")
    except (OSError, KeyError, TypeError, ValueError, IndexError) as error:
        raise SceneError(f"{path} cannot be used: {error}; without it, the scene stays as it was trained.") from error
    U, _, Vt = np.linalg.svd(R)
    return DataTransform(R=U @ Vt, t=T[:3, 3], scale=scale)


def _load(path: Path) -> Mapping[str, Any]:
    _refuse_inflated(path)
    try:
        import torch
    except ImportError as error:
        raise SceneError(f"{path} is a checkpoint, which torch reads; run: {install_command('train')}") from error
    names = ("numpy.core.multiarray.scalar", "numpy._core.multiarray.scalar", "numpy.dtype")
    try:
        with torch.serialization.safe_globals([(_Inert, name) for name in names]):
            checkpoint = torch.load(str(path), map_location="cpu", weights_only=True, mmap=True)
    except OSError:
        raise
    except Exception as error:  # torch raises many kinds for damaged files
        line = str(error).strip().split("\n")[0]
        raise SceneError(f"{path} is not a checkpoint of plain tensors: {line}") from error
    if not isinstance(checkpoint, Mapping):
        kind = type(checkpoint).__name__
        raise SceneError(f"{path} holds a {kind}, not a dictionary; import the training's point_cloud.ply instead.")
    return checkpoint


def _refuse_inflated(path: Path) -> None:
    """Raise SceneError for archives that unpack to more than their size; torch stores its tensors as they are."""
    try:
        with open_zip(path) as archive:
            entries = archive.infolist()
    except OSError:
        raise
    except Exception as error:  # a damaged archive raises almost anything
        line = " ".join(str(error).split())[:300] or type(error).__name__
        raise SceneError(f"{path} is truncated or damaged: {line}; copy it again.") from error
    if not any(entry.filename.endswith("data.pkl") for entry in entries):
        raise SceneError(f"{path} is a zip archive without a torch checkpoint in it; unpack it first.")
    if sum(entry.file_size for entry in entries) > path.stat().st_size:
        raise SceneError(f"{path} claims to unpack to more than its size, which torch never writes; export it again.")


def _cloud(state: Mapping[str, Any], prefix: str, names: Mapping[str, str], path: Path) -> GaussianCloud:
    arrays = {part: _array(state, prefix + name, path) for part, name in names.items()}
    count = arrays["means"].size // 3
    found = [arrays[part].size for part in ("means", "scales", "quats", "opacities", "dc")]
    rest = arrays["rest"].size // max(count, 1)
    if count == 0 or found != [n * count for n in (3, 3, 4, 1, 3)] or rest not in SH_REST_COUNTS:
        shapes = {part: array.shape for part, array in arrays.items()}
        raise SceneError(f"{path} has tensors that make no Gaussians: {shapes}; export it again.")
    dc = arrays["dc"].reshape(count, 1, 3)
    if names is _SPLATFACTO and rest == 0:
        # Without view-dependent colour, splatfacto stores logits of plain colours instead.
        dc = sh_of_rgb(opacities_from_logits(dc))
    return GaussianCloud(
        means_m=arrays["means"].reshape(count, 3),
        quats_wxyz=arrays["quats"].reshape(count, 4),
        scales_m=scales_from_logs(arrays["scales"].reshape(count, 3)),
        opacities=opacities_from_logits(arrays["opacities"].reshape(count)),
        sh=np.concatenate([dc, arrays["rest"].reshape(count, -1, 3) if rest else dc[:, :0]], axis=1),
    )


def _array(state: Mapping[str, Any], name: str, path: Path) -> Float32Array:
    tensor = state.get(name)
    if tensor is None or str(getattr(tensor, "layout", "")) != "torch.strided" or not tensor.is_floating_point():
        hint = "; trainings with appearance embeddings have no plain colours" if "colors" in state else ""
        raise SceneError(f"{path} has no tensor {name!r}{hint}; import a .ply that the training exported.")
    # A tensor may repeat few stored numbers without end.
    if tensor.numel() * tensor.element_size() > path.stat().st_size:
        raise SceneError(f"{path} has a tensor {name!r} of {tuple(tensor.shape)}, more than the file holds.")
    array: Float32Array = tensor.detach().float().numpy().copy()
    return array
