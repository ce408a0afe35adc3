import errno
from pathlib import Path

import pytest
import torch

from readygo.common.config import section_to_mapping
from readygo.common.errors import PolicyError
from readygo.common.robot import RobotConfig
from readygo.services.trainer.checkpoint import (
    CHECKPOINT_FORMAT,
    load_checkpoint,
    read_state,
    refuse_damaged,
    save_checkpoint,
    write_state,
)

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


@pytest.mark.parametrize("changed", [{"format": "readygo-training/1"}, {"identity": None}])
def test_checkpoint_of_another_version_is_refused(tmp_path, changed):
    write_state({"format": CHECKPOINT_FORMAT, "identity": IDENTITY} | changed, tmp_path / "checkpoint.pt")
    with pytest.raises(PolicyError, match="no checkpoint of this version; give another --out"):
        load_checkpoint(tmp_path, IDENTITY)


DAMAGED = r"checkpoint\.pt is damaged, or of another version: restore it from a copy, or give another --out\.$"


@pytest.mark.parametrize("content", [b"", b"no checkpoint"])
def test_file_that_is_no_checkpoint_is_named(tmp_path, content):
    (tmp_path / "checkpoint.pt").write_bytes(content)
    with pytest.raises(PolicyError, match=DAMAGED):
        load_checkpoint(tmp_path, IDENTITY)


@pytest.mark.parametrize("length", [100, 2000, 5000, 200_000])
def test_checkpoint_that_was_cut_off_is_named_at_every_length(tmp_path, length):
    save_checkpoint({"identity": IDENTITY, "weights": torch.arange(100_000.0)}, tmp_path)
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(PolicyError, match=DAMAGED) as refusal:
        load_checkpoint(tmp_path, IDENTITY)
    assert str(refusal.value).startswith(f"{path} is damaged")


def test_checkpoint_that_cannot_be_opened_is_reported_with_the_cause(tmp_path):
    (tmp_path / "checkpoint.pt").mkdir()
    with pytest.raises(PolicyError, match=r"checkpoint\.pt cannot be read: Is a directory\.$"):
        read_state(tmp_path / "checkpoint.pt")


def test_content_that_cannot_be_used_is_reported_as_damage(tmp_path):
    for error in (KeyError("step"), TypeError("unexpected"), RuntimeError("size mismatch"), ValueError("shape")):
        with pytest.raises(PolicyError, match=DAMAGED), refuse_damaged(tmp_path / "checkpoint.pt"):
            raise error
    with pytest.raises(PolicyError, match=r"^mine$"), refuse_damaged(tmp_path / "checkpoint.pt"):
        raise PolicyError("mine")


def test_pickled_objects_in_a_checkpoint_are_refused(tmp_path):
    torch.save({"format": "readygo-training/2", "identity": pytest.approx}, tmp_path / "checkpoint.pt")
    with pytest.raises(PolicyError, match=DAMAGED):
        load_checkpoint(tmp_path, IDENTITY)
