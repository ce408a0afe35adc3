import subprocess
import sys

import pytest

from readygo.common.lazy import lazy_names


def test_name_is_loaded_from_its_module_when_it_is_first_used(monkeypatch: pytest.MonkeyPatch) -> None:
    load = lazy_names("readygo.common", {".errors": ("RunError",), "json": ("dumps",)})
    from readygo.common.errors import RunError

    monkeypatch.setattr("readygo.common.RunError", None, raising=False)
    assert load("RunError") is RunError
    assert sys.modules["readygo.common"].RunError is RunError
    with pytest.raises(AttributeError, match=r"module 'readygo.common' has no attribute 'other'"):
        load("other")


def test_settings_of_a_run_and_its_coordinator_load_no_algorithm() -> None:
    code = (
        "import sys, readygo.apps.fleet.worker, readygo.runs.config; "
        "print([name for name in ('numba', 'scipy', 'torch', 'cv2', 'onnxruntime') if name in sys.modules])"
    )
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"
