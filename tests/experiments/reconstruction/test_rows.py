import json
from typing import Any

import pytest

from experiments.reconstruction.rows import print_row
from readygo.common.errors import SceneError


def missing() -> dict[str, Any]:
    raise SceneError("There are no poses.")


def test_values_are_lines_or_one_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert print_row(lambda: {"views": 3, "wall_median_m": 0.1}, as_json=False) == 0
    assert [line.split() for line in capsys.readouterr().out.splitlines()] == [["views", "3"], ["wall_median_m", "0.1"]]
    assert print_row(lambda: {"views": 3}, as_json=True) == 0
    assert json.loads(capsys.readouterr().out) == {"views": 3}


def test_a_users_mistake_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert print_row(missing, as_json=True) == 2
    assert capsys.readouterr().err == "Error: There are no poses.\n"
