import importlib.util

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.errors import ReadygoError  # noqa: E402
from readygo.common.rasterizer.gpu import availability  # noqa: E402
from readygo.common.rasterizer.gpu.availability import require_kernels  # noqa: E402

find_spec = importlib.util.find_spec


def test_unknown_kernels_are_refused() -> None:
    with pytest.raises(ValueError, match="must be one of triton, gsplat"):
        require_kernels("opengl", "cuda")


@pytest.mark.parametrize("kernels", availability.KERNELS)
def test_missing_package_names_the_extra(kernels: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == kernels else find_spec("json"))
    with pytest.raises(ReadygoError, match=r"pip install -e .*\[gpu\]"):
        require_kernels(kernels, "cuda")


@pytest.mark.parametrize("interpreted", [False, True])
@pytest.mark.parametrize("kernels", availability.KERNELS)
def test_machine_without_a_gpu_is_refused_in_one_line(
    kernels: str, interpreted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: find_spec("json"))
    monkeypatch.setattr(availability, "_is_interpreted", lambda: interpreted)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(ReadygoError, match="need a CUDA device") as caught:
        require_kernels(kernels, "cuda")
    assert "\n" not in str(caught.value)


def test_interpreter_runs_on_the_cpu_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: find_spec("json"))
    monkeypatch.setattr(availability, "_is_interpreted", lambda: True)
    require_kernels("triton", "cpu")
    monkeypatch.setattr(availability, "_is_interpreted", lambda: False)
    with pytest.raises(ReadygoError, match="need a CUDA device"):
        require_kernels("triton", "cpu")


def test_gsplat_that_would_compile_without_a_compiler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "gsplat.csrc" else find_spec("json"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(availability, "_has_compiler", lambda: False)
    with pytest.raises(ReadygoError, match="no compiled kernels"):
        require_kernels("gsplat", "cuda")


def test_gsplat_with_compiled_kernels_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: find_spec("json"))
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    require_kernels("gsplat", "cuda")
