import io
import math
from types import SimpleNamespace

from rich.console import Console

from readygo.apps.commands.train import _progress


def test_losses_are_shown_once_they_are_known() -> None:
    console = Console(file=io.StringIO(), width=200, force_terminal=True, color_system=None)
    with _progress(console, quiet=False) as show:
        show(SimpleNamespace(fraction=0.1, step=0, train_loss=math.nan, validation_loss=math.nan))
        show(SimpleNamespace(fraction=0.5, step=7, train_loss=0.25, validation_loss=math.nan))
    shown = console.file.getvalue()
    assert "step 7, loss 0.2500, ETA" in shown
    assert "nan" not in shown
