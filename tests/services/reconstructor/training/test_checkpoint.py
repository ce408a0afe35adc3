"""The state of a training on disk."""

from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import RunError
from readygo.services.reconstructor.training.checkpoint import CHECKPOINT_FILE, load_checkpoint, save_checkpoint


def test_state_comes_back(tmp_path: Path) -> None:
    assert load_checkpoint(tmp_path, "a") is None
    save_checkpoint(tmp_path, "a", {"step": 7}, {"x": np.arange(3.0)})
    found = load_checkpoint(tmp_path, "a")
    assert found is not None
    assert found[0]["step"] == 7
    np.testing.assert_array_equal(found[1]["x"], np.arange(3.0))


def test_state_of_another_training_is_refused(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, "a", {"step": 7}, {})
    with pytest.raises(RunError, match="other settings or images"):
        load_checkpoint(tmp_path, "b")


def test_broken_state_is_refused(tmp_path: Path) -> None:
    (tmp_path / CHECKPOINT_FILE).write_bytes(b"PK broken")
    with pytest.raises(RunError, match="delete it to start the training again"):
        load_checkpoint(tmp_path, "a")
