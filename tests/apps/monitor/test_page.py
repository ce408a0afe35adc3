import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.monitor.page import EYES, FOLLOW, LIVE, Page
from readygo.apps.monitor.splats import DollsHouse, splats_of
from readygo.apps.monitor.subject import Subject
from readygo.apps.pictures.perceived import PERCEIVED
from readygo.common.drawing.files import jpeg_bytes
from readygo.common.messages import topics
from readygo.common.messages.live import LivePreview
from tests.apps.monitor.fakes import Client
from tests.apps.monitor.test_splats import make_cloud
from tests.apps.monitor.test_watch import renderer, states
from tests.apps.monitor.watched import status, tell_status, watched
from tests.common.perception.test_live import perception
from tests.waiting import wait_for


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


def test_live_images_show_the_people_that_the_driver_perceives() -> None:
    run, watch = watched()
    subject = Subject("run")
    subject.watch = watch
    worker = renderer(run, watch)
    client, page = page_of(subject)
    state, told = states()[0], perception()
    plain = jpeg_bytes(np.full((144, 256, 3), 128, np.uint8))
    worker.tell(topics.STATE, state)
    preview = LivePreview(episode=state.episode, time_ns=told.time_ns, format="jpeg", image=plain)
    worker.tell(topics.PREVIEW, preview)
    wait_for(lambda: watch.under_way() and watch.under_way()[0].previews)
    page.update(watch.clock())
    view = "/robots/render0/robot/body/view"
    assert client.scene.nodes[view].image.shape == (144, 256, 3)
    worker.tell(topics.PERCEPTION, dataclasses.replace(told, episode=state.episode))
    wait_for(lambda: watch.under_way()[0].perception)
    page.update(watch.clock() + 1.0)
    marked = client.scene.nodes[view].image
    assert marked.shape == (288, 512, 3)
    assert np.abs(marked.astype(int) - PERCEIVED).sum(axis=-1).min() < 90
    assert "/robots/render0/tracks" in client.scene.nodes
    # An image of another time shows what it shows.
    worker.tell(topics.PREVIEW, dataclasses.replace(preview, time_ns=told.time_ns + 1))
    wait_for(lambda: len(watch.under_way()[0].previews) == 2)
    page.update(watch.clock() + 2.0)
    assert client.scene.nodes[view].image.shape == (144, 256, 3)


def test_damaged_episode_is_said_not_raised(data: Path) -> None:
    subject = Subject("data", data=data)
    client, page = page_of(subject)
    page.update(0.0)
    (shard,) = data.glob("shard-*.mcap")
    shard.write_bytes(b"no shard any more")
    client.gui.inputs["Episode"].choose(list(client.gui.inputs["Episode"].options)[1])
    assert client.said
    page.update(0.1)
