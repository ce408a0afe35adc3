import errno
import json
import threading
from pathlib import Path

import pytest

from readygo.common.errors import BusError, PeerError, PolicyError
from readygo.common.messages import EpisodeKey, OfferReply, Split
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.policy import load_policy
from readygo.services.trainer.live import DECAY_FILE, REFUSALS_MAX, STOP_FILE, LiveTrainer
from tests.services.trainer.conftest import make_source, quick
from tests.services.trainer.test_episodes import message, sample

CONFIG = quick(samples=320, offer_every_s=0.2, validation_fraction=0.2, ahead_s=0.05)
OFTEN = quick(samples=320, offer_every_s=1e-6)


@pytest.fixture(autouse=True)
def _few_episodes_are_enough(monkeypatch):
    monkeypatch.setattr("readygo.services.trainer.live.FIRST_EPISODES", 3)


def episode(index, **fields):
    """An episode as the recorder announces it."""
    source = make_source(episodes=1, samples=30, seed=index)
    samples = [
        sample(k, image=source.image(k), action_v_mps=float(v), action_w_radps=float(w))
        for k, (v, w) in enumerate(source.actions)
    ]
    header = {"height_px": 32, "width_px": 64, "driver": DriverKind.EXPERT, "policy": "", "outcome": Outcome.SUCCESS}
    return message(samples, episode=EpisodeKey(seed=0, split=Split.TRAIN, index=index), **(header | fields))


class Fleet:
    """Takes policies, and notes which ones."""

    def __init__(self):
        self.offered = []

    def offer(self, request):
        self.offered.append({file.name: file.data for file in request.files})
        return OfferReply(version=len(self.offered), sha256=f"{len(self.offered):064}")


@pytest.fixture
def fleet():
    return Fleet()


@pytest.fixture
def make_trainer(tmp_path, source, fleet):
    def make(config=CONFIG, **fields):
        return LiveTrainer(source.robot, source.sensor, config, tmp_path, **({"offer": fleet.offer} | fields))

    return make


def progress(folder):
    return json.loads((folder / "progress.json").read_text())


def test_trainer_tells_of_itself_while_it_reads_much_data(make_trainer, tmp_path, monkeypatch):
    monkeypatch.setattr("readygo.services.trainer.live.PROGRESS_EVERY_S", 0.0)
    told = []

    def catch_up():
        if not told:
            for index in range(4):
                yield "run", episode(index)
                told.append(progress(tmp_path))

    make_trainer(catch_up=catch_up).train(threading.Event())
    assert [entry["state"] for entry in told] == ["reading"] * 4
    assert [sum(entry["episodes"].values()) for entry in told] == [1, 2, 3, 4]


def test_what_is_heard_is_learned_and_offered(make_trainer, fleet, tmp_path):
    shown = []
    trainer = make_trainer(show=shown.append)
    for index in range(6):
        trainer.hear("run", episode(index))
    trainer.train(threading.Event())
    assert fleet.offered
    assert set(fleet.offered[0]) == {"policy.onnx", "policy.toml"}
    told = progress(tmp_path)
    assert told["state"] == "ended"
    assert told["samples"] == 320
    assert sum(told["episodes"].values()) == 6
    assert [entry["sha256"] for entry in told["offers"]] == [f"{k + 1:064}" for k in range(len(fleet.offered))]
    for entry in told["offers"]:
        load_policy(tmp_path / entry["folder"])
    load_policy(tmp_path)
    history = progress(tmp_path)["history"]
    assert [(loss.steps, loss.validation_loss) for loss in shown] == [
        (entry["step"], entry["validation_loss"]) for entry in history
    ]


def test_episodes_that_were_missed_are_read_and_none_is_learned_twice(make_trainer, tmp_path):
    trainer = make_trainer(catch_up=lambda: [("run", episode(k)) for k in range(4)])
    for index in (1, 2, 4):
        trainer.hear("run", episode(index))
    trainer.hear("other", episode(1))
    trainer.train(threading.Event())
    assert sum(progress(tmp_path)["episodes"].values()) == 6


def test_training_waits_for_enough_episodes_and_ends_when_asked(make_trainer, fleet, tmp_path):
    stop, trainer = threading.Event(), make_trainer()
    trainer.hear("run", episode(0))
    thread = threading.Thread(target=trainer.train, args=(stop,))
    thread.start()
    thread.join(0.7)
    assert thread.is_alive()
    stop.set()
    thread.join(30)
    assert not thread.is_alive()
    assert progress(tmp_path)["steps"] == 0
    assert not fleet.offered


def test_stop_file_ends_training_with_a_policy_and_a_later_run_goes_on(make_trainer, tmp_path):
    episodes = [("run", episode(k)) for k in range(5)]

    class StopsSoon:
        asked = 0

        def __call__(self):
            self.asked += 1
            if self.asked == 2:
                (tmp_path / STOP_FILE).touch()
            return episodes

    trainer = make_trainer(quick(samples=10**9), catch_up=StopsSoon())
    assert trainer.train(threading.Event())["steps"] > 0
    assert not (tmp_path / STOP_FILE).exists()
    load_policy(tmp_path)
    steps = progress(tmp_path)["steps"]
    again = make_trainer(quick(samples=32 * (steps + 3)), catch_up=lambda: episodes)
    assert again.train(threading.Event())["steps"] == steps + 3


def test_decay_file_ends_training_after_a_fall(make_trainer, tmp_path):
    trainer = make_trainer(quick(samples=32000), catch_up=lambda: [("r", episode(k)) for k in range(5)])
    (tmp_path / DECAY_FILE).touch()
    assert trainer.train(threading.Event())["steps"] < 100
    # It does not count for a later call with a larger budget.
    assert not (tmp_path / DECAY_FILE).exists()


def test_success_of_the_policy_is_told_from_its_own_episodes(make_trainer, tmp_path):
    trainer = make_trainer()
    endings = [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.HUMAN_COLLISION, Outcome.TIMEOUT]
    for index, outcome in enumerate(endings):
        trainer.hear("run", episode(index, driver=DriverKind.POLICY, policy="ab" * 32, outcome=outcome))
    trainer.hear("run", episode(9, driver=DriverKind.POLICY, policy="ab" * 32, avatars=(), encounters=()))
    trainer.hear("run", episode(10))
    trainer.train(threading.Event())
    success = progress(tmp_path)["success"]
    assert success["dynamic"] == {"episodes": 4, "rate": 0.5}
    assert success["static"] == {"episodes": 1, "rate": 1.0}


def test_fleet_that_does_not_answer_does_not_stop_training(make_trainer, tmp_path):
    def offer(_):
        raise BusError("nobody answers")

    trainer = make_trainer(offer=offer, catch_up=lambda: [("r", episode(k)) for k in range(5)])
    assert trainer.train(threading.Event())["samples_seen"] == 320
    assert "sha256" not in progress(tmp_path)["offers"][0]


def test_fleet_that_refuses_policy_after_policy_ends_training_with_its_reason(make_trainer):
    asked = []

    def offer(_):
        asked.append(1)
        raise PeerError("another robot")

    trainer = make_trainer(OFTEN, offer=offer, catch_up=lambda: [("r", episode(k)) for k in range(5)])
    with pytest.raises(PolicyError, match="cannot use what is trained for it: another robot"):
        trainer.train(threading.Event())
    assert len(asked) == REFUSALS_MAX


def test_fleet_that_takes_the_next_policy_after_a_refusal_goes_on(make_trainer):
    asked = []

    def offer(_):
        asked.append(1)
        if len(asked) % 2:
            raise PeerError("a message that went astray")
        return OfferReply(version=1, sha256="ab" * 32)

    trainer = make_trainer(OFTEN, offer=offer, catch_up=lambda: [("r", episode(k)) for k in range(5)])
    assert trainer.train(threading.Event())["samples_seen"] == 320
    assert len(asked) > REFUSALS_MAX


def test_images_of_another_size_are_left_out(make_trainer, tmp_path):
    trainer = make_trainer(catch_up=lambda: [("r", episode(k)) for k in range(5)])
    trainer.hear("run", episode(7, height_px=16))
    trainer.train(threading.Event())
    assert sum(progress(tmp_path)["episodes"].values()) == 5


@pytest.mark.parametrize("file", ["policy.onnx", "progress.json"])
def test_full_disk_ends_training_in_one_line_and_with_room_it_goes_on(make_trainer, tmp_path, monkeypatch, file):
    def full(path, data):
        if path.parent.name.startswith(f".{Path(file).stem}-"):
            raise OSError(errno.ENOSPC, "No space left on device")
        return write_bytes(path, data)

    write_bytes = Path.write_bytes
    trainer = make_trainer(catch_up=lambda: [("r", episode(k)) for k in range(5)])
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(PolicyError, match=rf"{file} cannot be written: No space left on device\.$"):
        trainer.train(threading.Event())
    with pytest.raises(PolicyError, match=r"policy\.toml"):
        load_policy(tmp_path)
    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    again = make_trainer(catch_up=lambda: [("r", episode(k)) for k in range(5)])
    assert again.train(threading.Event())["samples_seen"] == 320
    load_policy(tmp_path)
