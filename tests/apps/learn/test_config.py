from pathlib import Path

import pytest

from readygo.apps.learn.config import LearnConfig, load_learn_config
from readygo.common.errors import ConfigError
from readygo.runs.config import load_run_config


def test_own_section_is_read_beside_those_of_the_runs(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text("[learn]\nreuse = 8\n[episode]\nhuman_count_max = 3\n")
    assert load_learn_config(tmp_path / "run.toml") == LearnConfig(reuse=8.0)
    assert load_run_config(tmp_path / "run.toml").episode.human_count_max == 3
    assert load_learn_config(None) == LearnConfig()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mix = 1.5", "mix must be at least 0 and at most 1"),
        ("reuse = 0", "reuse must be above 0"),
        ("hope = 1", "hope"),
        ("memory = -1", "memory must be at least 0 and at most 1024, got -1"),
        ("memory = 1025", "memory must be at least 0 and at most 1024, got 1025"),
        ('teacher = "me"', "teacher"),
        ('memory = 64\ngoal = "both"', 'memory goes with goal "point"'),
    ],
)
def test_setting_that_makes_no_sense_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "run.toml").write_text(f"[learn]\n{text}\n")
    with pytest.raises(ConfigError, match=message):
        load_learn_config(tmp_path / "run.toml")


def test_section_that_is_no_table_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text("learn = 3\n")
    with pytest.raises(ConfigError, match="learn must be a table, got 3"):
        load_learn_config(tmp_path / "run.toml")
