"""Training of a network: weights as the evaluator reads them, and runs that continue."""

from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.errors import DatasetError, PolicyError  # noqa: E402
from readygo.common.networks import checkpoint  # noqa: E402
from readygo.common.networks.models import _sum_steps  # noqa: E402
from readygo.services.trainer.checkpoint import read_state, write_state  # noqa: E402
from readygo.services.trainer.networks import train as module  # noqa: E402
from readygo.services.trainer.networks.config import NetworkTrainConfig  # noqa: E402
from readygo.services.trainer.networks.samples import Looks  # noqa: E402


class Small(torch.nn.Module):
    """In the place of GNM: as fast as a test has to be."""

    frames, width_px, height_px = 2, 4, 3

    def __init__(self) -> None:
        super().__init__()
        self.layer = torch.nn.Linear(3 * 36, 21)

    def predict(self, images, goals):
        answers = self.layer(torch.cat([images.flatten(1), goals.flatten(1)], dim=1))
        return answers[:, 0], _sum_steps(answers[:, 1:])

    def waypoints(self, images, goals, generator):
        return self.predict(images, goals)[1]


class Data:
    """Episodes whose images say how fast the robot drives."""

    content_hash = "ab"

    episodes = tuple(SimpleNamespace(episode=SimpleNamespace(episode_id=f"episode {n}")) for n in range(20))

    def decode(self, row: int) -> np.ndarray:
        return np.full((6, 8, 3), 10 * (row // 30), np.uint8)


def looks_of(dataset, names) -> Looks:
    count = 30 * len(names)
    speed = np.repeat(np.arange(len(names)), 30) / 12
    x = np.arange(count) % 30 * speed
    first = np.arange(count) // 30 * 30
    return Looks(
        rows=np.arange(count),
        first=first,
        last=first + 29,
        xyyaw=np.stack([x, 0 * x, 0 * x], axis=1),
        unit_m=0.25,
    )


@pytest.fixture
def data(monkeypatch: pytest.MonkeyPatch) -> Data:
    for place in (module, checkpoint):
        monkeypatch.setattr(place, "NETWORKS", {"gnm": Small})
    monkeypatch.setattr(module, "looks_of", looks_of)
    threads = torch.get_num_threads()
    yield Data()
    torch.set_num_threads(threads)


def config(**settings) -> NetworkTrainConfig:
    return NetworkTrainConfig(network="gnm", threads=1, batch_size=16, **settings)


def test_loss_falls_and_the_weights_are_read_as_published_ones(data, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(module, "VALIDATION_FRACTION", 0.4)
    losses = []
    metrics = module.train_network(
        data,
        config(samples=3200, learning_rate=5e-3),
        tmp_path / "gnm_large.pth",
        lambda state: losses.append(state.train_loss),
    )
    assert np.mean(losses[-20:]) < 0.8 * np.mean(losses[:20])
    assert metrics["samples_seen"] == 3200
    assert metrics["waypoint_error_m"] < metrics["waypoint_error_of_mean_m"]
    assert isinstance(checkpoint.load_network("gnm", tmp_path / "gnm_large.pth"), Small)


def test_run_that_is_continued_ends_as_one_that_was_not(data, tmp_path) -> None:
    whole, parts = tmp_path / "whole" / "gnm.pth", tmp_path / "parts" / "gnm.pth"
    module.train_network(data, config(samples=160), whole)
    for samples in (64, 160):
        module.train_network(data, config(samples=samples), parts)
    ours, theirs = (checkpoint.load_network("gnm", path).state_dict() for path in (whole, parts))
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)
    with pytest.raises(PolicyError, match="other data or settings"):
        module.train_network(data, config(samples=160, seed=1), parts)


def test_weights_that_lie_there_are_where_training_begins(data, tmp_path) -> None:
    path, given = tmp_path / "gnm.pth", Small()
    checkpoint.save_network(given, path)
    module.train_network(data, config(samples=16, learning_rate=1e-9), path)
    weights = checkpoint.load_network("gnm", path).state_dict()
    assert all(torch.allclose(weights[name], tensor, atol=1e-6) for name, tensor in given.state_dict().items())
    (tmp_path / "gnm.pth.training").write_bytes(b"half a file")
    with pytest.raises(PolicyError, match=r"training is damaged"):
        module.train_network(data, config(samples=16), path)


@pytest.mark.parametrize("name", ["data", "network", "steps"])
def test_run_whose_state_lacks_something_is_refused(name: str, data, tmp_path) -> None:
    path = tmp_path / "gnm.pth"
    module.train_network(data, config(samples=16), path)
    state = read_state(tmp_path / "gnm.pth.training")
    del state[name]
    write_state(state, tmp_path / "gnm.pth.training")
    with pytest.raises(PolicyError, match=r"training is damaged"):
        module.train_network(data, config(samples=32), path)


def test_training_ends_without_measures_where_too_few_held_out_episodes_can_be_used(
    data, tmp_path, monkeypatch
) -> None:
    def looks_of_many(dataset, names) -> Looks:
        if len(names) < 3:
            raise DatasetError("Networks learn from two or more of the expert's episodes; there is 1.")
        return looks_of(dataset, names)

    monkeypatch.setattr(module, "looks_of", looks_of_many)
    metrics = module.train_network(data, config(samples=16), tmp_path / "gnm.pth")
    assert (metrics["samples_seen"], metrics["episodes"]) == (16, 18)
    assert "waypoint_error_m" not in metrics
