import dataclasses
import json
import threading

import pytest

pytest.importorskip("torch", reason="torch is not installed")

from readygo.apps.fleet import trainer
from readygo.apps.fleet.trainer import Reader, train_beside
from readygo.common.bus import InProcessBus
from readygo.common.camera import CameraConfig
from readygo.common.errors import RunError
from readygo.common.messages import OfferReply, topics
from readygo.common.policy import load_policy
from readygo.common.robot import RobotConfig
from readygo.runs.config import RunConfig, resolved_sections
from readygo.services.trainer import with_overrides
from tests.common.messages.run_specs import SPEC
from tests.services.trainer.test_live import CONFIG, episode

ROBOT = RobotConfig(camera=CameraConfig(height_px=32, width_px=64))


def make_bus(robot=ROBOT):
    """A fleet of which only the coordinator is there, and the number of policies that it was offered."""
    bus, offered = InProcessBus(), []
    spec = dataclasses.replace(SPEC, config=resolved_sections(RunConfig(robot=robot)))
    bus.serve(topics.SPEC, lambda _: spec)
    bus.serve(topics.OFFER, lambda request: (offered.append(request), OfferReply(version=1, sha256="ab" * 32))[1])
    return bus, offered


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A data folder with four episodes, enough to begin with."""
    monkeypatch.setattr("readygo.services.trainer.live.FIRST_EPISODES", 3)
    monkeypatch.setattr(
        trainer,
        "committed_episodes",
        lambda _, known: [e for k in range(4) if (e := episode(k)).header.episode not in known],
    )
    return tmp_path / "data"


def test_trainer_learns_from_folders_and_fleets_and_offers_to_all(folder, tmp_path):
    (first, offered), (second, also_offered) = make_bus(), make_bus()
    out = tmp_path / "policy"
    config = with_overrides(CONFIG, samples=10**7, offer_every_s=0.05)
    stop = threading.Event()
    thread = threading.Thread(
        target=train_beside, args=({"a": first, "b": second}, config, out), kwargs={"data": (folder,), "stop": stop}
    )
    thread.start()
    while not also_offered:
        assert thread.is_alive()
        first.publish(topics.COMMITTED, episode(7))
        second.publish(topics.COMMITTED, episode(7))
        stop.wait(0.1)
    stop.set()
    thread.join(60)
    assert len(offered) >= len(also_offered) >= 1
    assert load_policy(out).spec.robot == ROBOT
    assert sum(json.loads((out / "progress.json").read_text())["episodes"].values()) == 6


def test_fleets_of_two_robots_are_refused(tmp_path):
    other = dataclasses.replace(ROBOT, v_max_mps=0.5)
    buses = {"a": make_bus()[0], "b": make_bus(other)[0]}
    with pytest.raises(RunError, match="different robots"):
        train_beside(buses, CONFIG, tmp_path, data=(), stop=threading.Event())


def test_fleet_that_records_no_goals_is_refused_where_they_are_learned_from(tmp_path):
    bus, _ = make_bus()
    config = with_overrides(CONFIG, goal="both")
    with pytest.raises(RunError, match="The fleet records no images of goals"):
        train_beside({"a": bus}, config, tmp_path / "policy", data=(), stop=threading.Event())


def test_reader_gives_every_episode_once(folder):
    reader = Reader({folder: "run"})
    assert [(run, message.header.episode.index) for run, message in reader.new_episodes()] == [
        ("run", index) for index in range(4)
    ]
    assert list(reader.new_episodes()) == []
