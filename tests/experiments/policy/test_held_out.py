from pathlib import Path

import pytest

from experiments.policy.held_out import errors
from readygo.common.errors import PolicyError
from readygo.services.trainer.train import train_policy
from tests.services.trainer.conftest import QUICK, make_source


def test_errors_are_those_that_the_training_saw_on_the_same_episodes(tmp_path: Path) -> None:
    unseen = make_source(seed=1)
    metrics = train_policy(make_source(), QUICK, tmp_path / "policy", validation=unseen)
    (row,) = errors(unseen, [tmp_path / "policy"], QUICK)
    assert row["rmse_w_radps"] == pytest.approx(metrics["rmse_w_radps"], rel=1e-5)
    assert row["samples_seen"] == QUICK.samples


def test_folder_without_a_checkpoint_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match=r"holds no checkpoint\.pt"):
        errors(make_source(), [tmp_path], QUICK)
