"""Whether this machine can draw on a GPU, said in one line if it cannot."""

import importlib.metadata
import importlib.util
import shutil

from readygo.common.errors import ReadygoError
from readygo.common.extras import install_command

KERNELS = ("triton", "gsplat")
"""Whose kernels can be chosen."""


def require_kernels(kernels: str, device: str) -> None:
    """Check that kernels can run on a device.

    Args:
        kernels: One of `KERNELS`.
        device: A torch device such as "cuda" or "cuda:1"; "cpu" only under Triton's interpreter.

    Raises:
        ValueError: If `kernels` is unknown.
        ReadygoError: If a package, a GPU or a compiler is missing.
    """
    if kernels not in KERNELS:
        raise ValueError(f"kernels must be one of {', '.join(KERNELS)}, got {kernels!r}.")
    for package in ("torch", kernels):
        if importlib.util.find_spec(package) is None:
            remedy = f"run: {install_command('gpu')}"
            raise ReadygoError(f"Drawing on a GPU with {kernels} kernels needs {package}; {remedy}")
    import torch

    if kernels == "triton" and torch.device(device).type == "cpu" and _is_interpreted():
        return
    if torch.device(device).type != "cuda" or not torch.cuda.is_available():
        raise ReadygoError(
            f"{kernels} kernels need a CUDA device, got device {device!r} and a torch {torch.__version__} that sees "
            f"{torch.cuda.device_count()} of them; use the cpu backend."
        )
    if kernels == "gsplat":
        _require_gsplat_kernels()


def device_class(kernels: str, device: str = "cuda") -> str:
    """What the bits of images depend on: the device, and the versions of torch and of the kernels' package.

    Raises:
        ReadygoError: If the kernels cannot run, see `require_kernels`.
    """
    require_kernels(kernels, device)
    import torch

    name = torch.cuda.get_device_name(device) if torch.cuda.is_available() else "interpreter"
    versions = [f"{package}-{importlib.metadata.version(package)}" for package in ("torch", kernels)]
    return " ".join([name.replace(" ", "-"), *versions])


def _is_interpreted() -> bool:
    from triton import knobs

    return bool(knobs.runtime.interpret)


def _require_gsplat_kernels() -> None:
    """Refuse a gsplat that is neither compiled nor could be: importing its kernels compiles them for minutes."""
    if importlib.util.find_spec("gsplat.csrc") is not None:
        return
    if not _has_compiler():
        raise ReadygoError(
            "This gsplat has no compiled kernels and there is no nvcc to compile them; install a gsplat wheel that is "
            "built for this torch and CUDA, or use triton kernels."
        )


def _has_compiler() -> bool:
    from torch.utils import cpp_extension

    return cpp_extension.CUDA_HOME is not None or shutil.which("nvcc") is not None
