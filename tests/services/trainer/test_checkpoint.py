import errno
from pathlib import Path

import pytest
import torch

from readygo.common.config import section_to_mapping
from readygo.common.errors import PolicyError
from readygo.common.robot import RobotConfig
from readygo.services.trainer.checkpoint import load_checkpoint, save_checkpoint

IDENTITY = {"robot": section_to_mapping(RobotConfig()), "training data": "a", "seed": 3}


def test_state_comes_back_as_it_was_saved(tmp_path):
    assert load_checkpoint(tmp_path, IDENTITY) is None
    save_checkpoint({"identity": IDENTITY, "step": 7, "weights": torch.arange(3.0)}, tmp_path)
    state = load_checkpoint(tmp_path, IDENTITY)
    assert state["step"] == 7
    assert state["weights"].tolist() == [0.0, 1.0, 2.0]
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.pt"]


def test_full_disk_is_one_line_and_leaves_the_checkpoint_before(tmp_path, monkeypatch):
    save_checkpoint({"identity": IDENTITY, "step": 7}, tmp_path)

    def full(path, data):
        with path.open("wb") as file:
            file.write(data[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(PolicyError, match=r"checkpoint\.pt cannot be written: No space left on device\.$"):
        save_checkpoint({"identity": IDENTITY, "step": 8}, tmp_path)
    assert load_checkpoint(tmp_path, IDENTITY)["step"] == 7
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint.pt"]


def test_run_of_another_identity_is_refused_by_the_first_name_that_differs(tmp_path):
    save_checkpoint({"identity": IDENTITY}, tmp_path)
    with pytest.raises(PolicyError, match="belongs to a run with another training data; give another --out"):
        load_checkpoint(tmp_path, IDENTITY | {"training data": "b"})
    with pytest.raises(PolicyError, match="with another seed"):
        load_checkpoint(tmp_path, IDENTITY | {"seed": 4, "training data": "b"})


def test_checkpoint_of_another_version_is_refused(tmp_path):
    torch.save({"format": "readygo-training/1", "identity": IDENTITY}, tmp_path / "checkpoint.pt")
    with pytest.raises(PolicyError, match="no checkpoint of this version; delete it"):
        load_checkpoint(tmp_path, IDENTITY)


def test_broken_checkpoint_is_named(tmp_path):
    (tmp_path / "checkpoint.pt").write_bytes(b"no checkpoint")
    with pytest.raises(PolicyError, match=r"checkpoint\.pt cannot be read: .*; delete it to start again"):
        load_checkpoint(tmp_path, IDENTITY)


def test_checkpoint_that_was_cut_off_is_refused_with_what_torch_says_of_it(tmp_path):
    save_checkpoint({"identity": IDENTITY, "weights": torch.arange(1000.0)}, tmp_path)
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(RuntimeError) as said:
        torch.load(path, weights_only=True)
    with pytest.raises(PolicyError) as refusal:
        load_checkpoint(tmp_path, IDENTITY)
    reason = str(said.value).splitlines()[0]
    assert reason
    assert str(refusal.value) == f"{path} cannot be read: {reason}; delete it to start again."


def test_pickled_objects_in_a_checkpoint_are_refused(tmp_path):
    torch.save({"format": "readygo-training/2", "identity": pytest.approx}, tmp_path / "checkpoint.pt")
    with pytest.raises(PolicyError, match="cannot be read"):
        load_checkpoint(tmp_path, IDENTITY)
