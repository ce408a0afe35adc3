import sys
from types import SimpleNamespace

import pytest

from readygo.common.errors import ConfigError, PolicyError
from readygo.runs.training import default_recipe, make_config, make_network_config, run_training
from readygo.services import trainer
from readygo.services.trainer import TrainConfig, best_recipe
from readygo.services.trainer.config import paper_recipe


def test_missing_torch_is_one_line_with_the_command_that_installs_it(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "readygo.services.trainer.train", None)
    monkeypatch.delitem(vars(trainer), "train_policy", raising=False)
    with pytest.raises(PolicyError, match=r"^Training needs .*; run: .*pip install -e .*\[train\]"):
        run_training(SimpleNamespace(), TrainConfig(), tmp_path / "policy")


def test_recipe_gives_what_no_setting_names() -> None:
    assert make_config("fast", minutes=2.0, learning_rate=None) == TrainConfig(minutes=2.0)
    paper = make_config("paper", minutes=None, batch_size=32)
    assert (paper.optimizer, paper.sampling.batch_size) == (paper_recipe().optimizer, 32)
    assert make_config("paper", learning_rate=0.01).optimizer.learning_rate == 0.01


def test_file_changes_what_it_names_settings_win_over_it_and_keys_over_both(tmp_path) -> None:
    file = tmp_path / "train.toml"
    file.write_text(
        "minutes = 3.0\n[network]\nfusion = 'early'\nwidths = [8, 8, 8, 8, 8]\n[sampling]\nhindsight = 0.1\n"
    )
    config = make_config("best", file, minutes=4.0)
    assert (config.minutes, config.network.fusion, config.sampling.hindsight) == (4.0, "early", 0.1)
    assert config.network.widths == (8, 8, 8, 8, 8)
    config = make_config("best", file, {"sampling": {"hindsight": 0.2}}, minutes=4.0, hindsight=0.3)
    assert (config.minutes, config.sampling.hindsight, config.network.fusion) == (4.0, 0.2, "early")
    assert config.network.motion == best_recipe().network.motion


@pytest.mark.parametrize(
    ("text", "message"),
    [("[network]\nfuse = 1", "network.fuse"), ("minutes = ", "cannot be read"), ("minutes = 0.0", "minutes")],
)
def test_file_that_makes_no_sense_is_one_line(tmp_path, text, message) -> None:
    (tmp_path / "train.toml").write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        make_config("best", tmp_path / "train.toml")
    assert "\n" not in str(caught.value)


def test_setting_that_makes_no_sense_is_one_line() -> None:
    with pytest.raises(ConfigError, match=r"^--batch-size must be at least 1, got 0\.$"):
        make_config("fast", batch_size=0)
    with pytest.raises(ConfigError, match=r"^--minutes must be above 0 and at most 100000, got 0\.$"):
        make_network_config("gnm", {"minutes": 0.0})


def test_best_is_for_data_in_which_the_expert_was_asked() -> None:
    assert default_recipe(SimpleNamespace(has_expert=True)) == "best"
    assert default_recipe(SimpleNamespace(has_expert=False)) == "fast"


def test_table_in_place_of_a_number_is_refused(tmp_path) -> None:
    (tmp_path / "a.toml").write_text("[minutes]\na = 1\n")
    with pytest.raises(ConfigError, match="minutes"):
        make_config("fast", tmp_path / "a.toml")
