import sys

import pytest

from readygo.apps.run.training import make_config, run_training
from readygo.common.errors import ConfigError, PolicyError
from readygo.services.trainer import TrainConfig


def test_missing_torch_is_one_line_with_the_command_that_installs_it(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "readygo.services.trainer.train", None)
    with pytest.raises(PolicyError, match=r"^Training needs .*; run: .*pip install -e .*\[train\]"):
        run_training((tmp_path,), TrainConfig(), tmp_path / "policy")


def test_recipe_gives_what_no_setting_names() -> None:
    assert make_config("fast", minutes=2.0, learning_rate=None) == TrainConfig(minutes=2.0)
    paper = make_config("paper", minutes=None, batch_size=32)
    assert (paper.learning_rate, paper.schedule, paper.batch_size) == (1e-4, "constant", 32)
    assert make_config("paper", learning_rate=0.01).learning_rate == 0.01


def test_setting_that_makes_no_sense_is_one_line() -> None:
    with pytest.raises(ConfigError, match=r"^batch_size must be at least 1, got 0\.$"):
        make_config("fast", batch_size=0)
