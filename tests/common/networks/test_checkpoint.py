"""Files of weights, whoever made them."""

import os
import sys
import types

import pytest

from readygo.common.errors import PolicyError

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks import checkpoint  # noqa: E402


class Small(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.first = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3), torch.nn.BatchNorm2d(4))
        self.second = torch.nn.Linear(4, 2)
        self.activation = torch.nn.functional.gelu


@pytest.fixture
def network(monkeypatch):
    monkeypatch.setattr(checkpoint, "NETWORKS", {"gnm": Small})
    return Small()


@pytest.fixture
def foreign(monkeypatch):
    """A module of a package that is gone when the file is read, within what trains in parallel."""
    package = types.ModuleType("vint_train.models.gnm")
    monkeypatch.setitem(sys.modules, "vint_train", types.ModuleType("vint_train"))
    monkeypatch.setitem(sys.modules, "vint_train.models", types.ModuleType("vint_train.models"))
    monkeypatch.setitem(sys.modules, "vint_train.models.gnm", package)
    package.GNM = type("GNM", (Small,), {"__module__": "vint_train.models.gnm"})
    return package.GNM


def same(network, other):
    state = other.state_dict()
    return all(torch.equal(tensor, state[key]) for key, tensor in network.state_dict().items())


def test_pickled_module_is_read_without_its_package(network, foreign, tmp_path, monkeypatch):
    module = foreign()
    parallel = torch.nn.Module()
    parallel.module = module
    torch.save({"epoch": 3, "model": parallel, "optimizer": {"state": {}}}, tmp_path / "gnm_large.pth")
    for name in ("vint_train.models.gnm", "vint_train.models", "vint_train"):
        monkeypatch.delitem(sys.modules, name)
    assert same(checkpoint.load_network("gnm", tmp_path / "gnm_large.pth"), module)


def test_state_dictionary_is_read(network, tmp_path):
    torch.save(network.state_dict(), tmp_path / "plain.pth")
    assert same(checkpoint.load_network("gnm", tmp_path / "plain.pth"), network)


def test_missing_file_is_named_with_where_it_goes(network, tmp_path):
    with pytest.raises(PolicyError, match=r"gnm needs its weights: put gnm_large\.pth of github\.com/.* at "):
        checkpoint.load_network("gnm", tmp_path / "gnm_large.pth")


class Evil:
    def __reduce__(self):
        return os.mkdir, (os.environ["READYGO_TEST_TRAP"],)


def test_file_that_would_run_something_is_refused_and_runs_nothing(network, tmp_path, monkeypatch):
    monkeypatch.setenv("READYGO_TEST_TRAP", str(tmp_path / "trap"))
    torch.save({"model": Evil()}, tmp_path / "evil.pth")
    with pytest.raises(PolicyError, match=r"names posix\.mkdir, which no such weights have use for"):
        checkpoint.load_network("gnm", tmp_path / "evil.pth")
    assert not (tmp_path / "trap").exists()


def test_what_is_no_checkpoint_or_holds_other_weights_is_refused_in_a_line(network, tmp_path):
    (tmp_path / "text.pth").write_text("weights")
    torch.save({"model": 3}, tmp_path / "empty.pth")
    torch.save({**network.state_dict(), "second.bias": torch.zeros(3)}, tmp_path / "other.pth")
    for name, said in {
        "text": "is no checkpoint of torch",
        "empty": "holds neither a module nor a state dictionary",
        "other": r"second\.bias is \(3,\) there, and should be \(2,\)",
    }.items():
        with pytest.raises(PolicyError, match=said) as caught:
            checkpoint.load_network("gnm", tmp_path / f"{name}.pth")
        assert "\n" not in str(caught.value)
