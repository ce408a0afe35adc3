from pathlib import Path

import numpy as np
import pytest

from readygo.apps.monitor.page import EYES, FOLLOW, LIVE, Page
from readygo.apps.monitor.splats import DollsHouse, splats_of
from readygo.apps.monitor.subject import Subject
from readygo.common.messages import topics
from tests.apps.monitor.fakes import Client
from tests.apps.monitor.test_splats import make_cloud
from tests.apps.monitor.test_watch import renderer, states
from tests.apps.monitor.watched import status, tell_status, wait_for, watched


def house() -> DollsHouse:
    splats = splats_of(make_cloud(20))
    return DollsHouse(open=splats, roof=splats, center_m=np.zeros(3), radius_m=5.0)


def page_of(subject: Subject) -> tuple[Client, Page]:
    client = Client()
    return client, Page(client, [subject])


def test_recorded_episode_plays_is_scrubbed_and_looked_through(data: Path) -> None:
    subject = Subject("data", data=data)
    subject.house = house()
    client, page = page_of(subject)
    page.update(0.0)
    inputs, nodes = client.gui.inputs, client.scene.nodes
    assert not nodes["/scene/roof"].visible, "one looks in from above"
    assert next(iter(inputs["Episode"].options)) == LIVE
    inputs["Episode"].choose(list(inputs["Episode"].options)[1])
    page.update(0.1)
    before = nodes["/robots/0/robot"].position
    page.update(0.6)
    assert nodes["/robots/0/robot"].position != before, "it moves"
    inputs["Time [s]"].choose(0.0)
    page.update(5.0)
    page.update(6.0)
    assert nodes["/robots/0/robot"].position == (0.01, 0.01, 0.0), "it stays where it was put"
    inputs["Camera"].choose(FOLLOW)
    page.update(5.1)
    assert np.linalg.norm(client.camera.position - np.array(before)) < 4.0
    inputs["Camera"].choose(EYES)
    page.update(5.2)
    assert nodes["/scene/roof"].visible
    assert any("data:image/jpeg" in text.content for text in client.gui.texts)


def test_page_of_a_finished_run_plays_by_itself(data: Path) -> None:
    subject = Subject("data", data=data)
    subject.watch.connection = "No fleet is at work."
    client, page = page_of(subject)
    page.update(0.0)
    wait_for(lambda: page._track is not None)
    page.update(0.1)
    assert "/robots/0/robot" in client.scene.nodes


def test_live_episodes_move_and_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    run, watch = watched()
    subject = Subject("run")
    subject.watch = watch
    worker = renderer(run, watch)
    tell_status(run, status())
    client, page = page_of(subject)
    for state in states():
        worker.tell(topics.STATE, state)
    wait_for(lambda: watch.under_way() and len(watch.under_way()[0].states) == 4 and watch.status)
    page.update(watch.clock() + 1.0)
    assert client.scene.nodes["/robots/render0/robot"].position == states()[-1].robot_xyzyaw[:3]
    assert any("400" in text.content for text in client.gui.texts)
    monkeypatch.setattr("readygo.apps.monitor.watch.FRESH_S", -1.0)
    page.update(watch.clock() + 2.0)
    assert "/robots/render0/robot" not in client.scene.nodes


def test_damaged_episode_is_said_not_raised(data: Path) -> None:
    subject = Subject("data", data=data)
    client, page = page_of(subject)
    page.update(0.0)
    (shard,) = data.glob("shard-*.mcap")
    shard.write_bytes(b"no shard any more")
    client.gui.inputs["Episode"].choose(list(client.gui.inputs["Episode"].options)[1])
    assert client.said
    page.update(0.1)
