import json
from pathlib import Path

import pytest

from readygo.benchmarks.rasterizer import gpu


@pytest.mark.parametrize(("as_json", "wanted"), [(False, "no gpu"), (True, {"gpu": None, "note": "no gpu"})])
def test_machine_without_a_gpu_gets_no_number(
    as_json: bool, wanted: object, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu, "_machine", lambda device: None)
    gpu.main(Path("nowhere"), json_output=as_json)
    said = capsys.readouterr().out.strip()
    assert (json.loads(said) if as_json else said) == wanted


def test_torch_without_cuda_is_no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert gpu._machine("cuda") is None
