import io
import math
from types import SimpleNamespace

import pytest
from rich.console import Console

from readygo.apps.commands.train import _default_recipe, _progress, train
from readygo.common.errors import ConfigError


def test_losses_are_shown_once_they_are_known() -> None:
    console = Console(file=io.StringIO(), width=200, force_terminal=True, color_system=None)
    with _progress(console, quiet=False) as show:
        show(SimpleNamespace(fraction=0.1, step=0, train_loss=math.nan, validation_loss=math.nan))
        show(SimpleNamespace(fraction=0.5, step=7, train_loss=0.25, validation_loss=math.nan))
    shown = console.file.getvalue()
    assert "step 7, loss 0.2500, ETA" in shown
    assert "nan" not in shown


def test_recipe_that_nobody_named_is_said() -> None:
    console = Console(file=io.StringIO(), width=200)
    assert _default_recipe(SimpleNamespace(has_expert=True), console, quiet=False) == "best"
    assert _default_recipe(SimpleNamespace(has_expert=False), console, quiet=True) == "fast"
    assert console.file.getvalue() == "Recipe best: the expert was asked at every state in these data.\n"


def test_what_is_missing_is_said(tmp_path) -> None:
    with pytest.raises(ConfigError, match="No data folder"):
        train((), out=tmp_path)
    with pytest.raises(ConfigError, match="--run"):
        train((), out=tmp_path, live="tcp/127.0.0.1:1")
