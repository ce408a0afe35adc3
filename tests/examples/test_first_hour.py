"""The notebook runs from its first cell to its last, with a small budget."""

import json
import re
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "first_hour.ipynb"
BUDGET = {"EPISODES": "2", "MINUTES": "0.02", "TESTS": "1"}
"""Values that replace the notebook's."""


def cells() -> list[str]:
    notebook = json.loads(NOTEBOOK.read_text())
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


def test_notebook_has_no_outputs() -> None:
    notebook = json.loads(NOTEBOOK.read_text())
    assert not any(cell.get("outputs") for cell in notebook["cells"])


@pytest.mark.slow
def test_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch", reason="torch (extra train) is not installed")
    first, *others = cells()
    for name, value in BUDGET.items():
        first, count = re.subn(rf"^{name} = [0-9.]+", f"{name} = {value}", first, flags=re.MULTILINE)
        assert count == 1
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(NOTEBOOK.parents[1]))
    names: dict[str, object] = {}
    for number, cell in enumerate([first, *others]):
        exec(compile(cell, f"cell {number}", "exec"), names)
    assert "expert" in capsys.readouterr().out
    assert (tmp_path / "first_hour" / "policy" / "policy.toml").is_file()
