"""Reads the user's model: state dict, args.json, feature statistics, text embedding."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from readygo.common.array_files import load_npy
from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.documents import read_json
from readygo.common.errors import ConfigError, first_line
from readygo.common.files import read_regular
from readygo.services.animator.priormdm.config import PriorMdmConfig
from readygo.services.animator.priormdm.features import FEATURE_COUNT
from readygo.services.animator.priormdm.network import TEXT_COUNT, Mdm, NetworkShape

_CONSTANTS = ("sequence_pos_encoder.pe", "embed_timestep.sequence_pos_encoder.pe", "t_pos_encoder.pe")
"""Tables that follow from a formula; releases keep, lengthen or drop them."""
_NUMBERS_BYTES_MAX = 2**16
_FOREIGN = "clip_model."
"""The text encoder, which some checkpoints carry along."""


@dataclass(frozen=True, kw_only=True)
class TrainedModel:
    """A denoiser and what its numbers mean."""

    network: Mdm
    diffusion_steps: int
    sigma_small: bool
    """True: the variance of the posterior; False: that of the forward process."""
    mask_frames: bool
    """True if the model was trained with padding masked out; the releases of 2022 and 2023 were not."""
    mean: Float64Array
    """Mean of the features, shape (263,)."""
    std: Float64Array
    text: Float32Array | None
    """CLIP embedding that conditions all motions, shape (512,)."""


def load_model(config: PriorMdmConfig) -> TrainedModel:
    """Load the files that a configuration names.

    Raises:
        ConfigError: If a file is not named, missing, of another layout, or another than the one recorded.
    """
    try:
        config.check_named()
    except ValueError as error:
        raise ConfigError(f"{error}") from error
    if not Path(config.weights).is_file():
        raise ConfigError(f"priormdm.weights {config.weights} cannot be read: no such file on this machine.")
    if config.sha256 and config.sha256 != files_digest(config):
        raise ConfigError(
            f"The priormdm files are others than the run's (sha256 {config.sha256[:12]}...); use those it began with."
        )
    args = _read_args(_args_path(config))
    shape = _shape_of(args, _args_path(config))
    network = Mdm(shape)
    load_state(network, _read_state(Path(config.weights)), config.weights)
    network.eval().requires_grad_(False).to(config.device)
    std = _read_numbers(config.std, FEATURE_COUNT, "priormdm.std")
    if not (std > 0.0).all():
        raise ConfigError(f"priormdm.std {config.std} must be positive; give HumanML3D's Std.npy.")
    words = config.text_embedding
    text = _read_numbers(words, TEXT_COUNT, "priormdm.text_embedding") if words else None
    if text is not None and not shape.text:
        raise ConfigError(f"{config.weights} was trained without texts; leave priormdm.text_embedding empty.")
    return TrainedModel(
        network=network,
        diffusion_steps=int(args["diffusion_steps"]),
        sigma_small=bool(args.get("sigma_small", True)),
        mask_frames=bool(args.get("mask_frames", False)),
        mean=_read_numbers(config.mean, FEATURE_COUNT, "priormdm.mean"),
        std=std,
        text=None if text is None else text.astype(np.float32),
    )


def files_digest(config: PriorMdmConfig) -> str:
    """SHA-256 over the digests of weights, args, mean, std, text embedding and, where one is named, the pose prior.

    It is what a run records of them.

    Raises:
        ConfigError: If a file cannot be read.
    """
    total = hashlib.sha256()
    paths = [config.weights, str(_args_path(config)), config.mean, config.std, config.text_embedding]
    for path in [*paths, *([config.pose_prior] if config.pose_prior else [])]:
        try:
            total.update(hashlib.sha256(read_regular(path) if path else b"").digest())
        except OSError as error:
            raise ConfigError(f"{path} cannot be read: {error.strerror or error}.") from error
    return total.hexdigest()


def load_state(network: Mdm, state: Mapping[str, Tensor], where: str) -> None:
    """Fill a network from a state dict of the released layout.

    Raises:
        ConfigError: If names or shapes differ; the line says which.
    """
    own = network.state_dict()
    given = {name: value for name, value in state.items() if not name.startswith(_FOREIGN) and name not in _CONSTANTS}
    needed = {name: value for name, value in own.items() if name not in _CONSTANTS}
    problems = []
    missing, unknown = sorted(set(needed) - set(given)), sorted(set(given) - set(needed))
    if missing:
        problems.append(f"missing {_some(missing)}")
    if unknown:
        problems.append(f"unknown {_some(unknown)}")
    for name in sorted(set(needed) & set(given)):
        have = tuple(given[name].shape) if isinstance(given[name], Tensor) else type(given[name]).__name__
        if have != tuple(needed[name].shape):
            problems.append(f"{name} is {have}, must be {tuple(needed[name].shape)}")
    if problems:
        raise ConfigError(
            f"{where} is not the model that its args.json describes: {'; '.join(problems[:4])}"
            f"{f'; and {len(problems) - 4} more' if len(problems) > 4 else ''}."
        )
    network.load_state_dict(given, strict=False)


def _some(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _args_path(config: PriorMdmConfig) -> Path:
    return Path(config.weights).parent / "args.json"


def _read_args(path: Path) -> dict[str, Any]:
    try:
        args = read_json(path)
    except OSError as error:
        raise ConfigError(
            f"priormdm needs the args.json that was released with the weights; {path} cannot be read: "
            f"{error.strerror or error}."
        ) from error
    except ValueError as error:
        raise ConfigError(f"{path} is not JSON: {error}.") from error
    missing = sorted({"layers", "latent_dim", "diffusion_steps"} - set(args)) if isinstance(args, dict) else ["layers"]
    if missing:
        raise ConfigError(f"{path} lacks {', '.join(missing)}; it must be the args.json of the model's training.")
    fixed: tuple[tuple[str, Any], ...] = (("arch", "trans_enc"), ("dataset", "humanml"), ("noise_schedule", "cosine"))
    for name, want in (*fixed, ("emb_trans_dec", False), ("concat_trans_emb", False)):
        if args.get(name, want) != want:
            raise ConfigError(f"{path} has {name} = {args[name]!r}; this source runs models with {name} = {want!r}.")
    return dict(args)


def _shape_of(args: Mapping[str, Any], path: Path) -> NetworkShape:
    steps = args["diffusion_steps"]
    if not isinstance(steps, int) or not 1 <= steps <= 4999:
        raise ConfigError(f"{path}: diffusion_steps must be within 1..4999, got {steps!r}.")
    try:
        return NetworkShape(
            layers=int(args["layers"]),
            latent_dim=int(args["latent_dim"]),
            ff_size=int(args.get("ff_size", 1024)),
            num_heads=int(args.get("num_heads", 4)),
            text=not args.get("unconstrained", False),
        )
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


def _read_state(path: Path) -> dict[str, Tensor]:
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise ConfigError(f"priormdm.weights {path} cannot be read: {error.strerror or error}.") from error
    except Exception as error:  # torch raises many kinds for damaged files
        raise ConfigError(f"priormdm.weights {path} is no plain state dict of torch: {first_line(error)}") from error
    for wrapper in ("model_avg", "model"):
        if isinstance(state, dict) and isinstance(state.get(wrapper), dict):
            state = state[wrapper]
    if not isinstance(state, dict):
        raise ConfigError(f"priormdm.weights {path} holds a {type(state).__name__}, must be a state dict.")
    return state


def _read_numbers(path: str, count: int, what: str) -> Float64Array:
    numbers = load_npy(Path(path), bytes_max=_NUMBERS_BYTES_MAX, raises=ConfigError)
    if numbers.size != count or numbers.dtype.kind not in "fiu" or not np.isfinite(numbers).all():
        raise ConfigError(f"{what} {path} must hold {count} finite numbers, got shape {np.shape(numbers)}.")
    return numbers.reshape(count).astype(np.float64)
