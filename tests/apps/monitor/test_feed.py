import dataclasses
import queue
from pathlib import Path

from readygo.apps.monitor.feed import Feed, LiveMoment
from readygo.apps.monitor.subject import Subject
from readygo.common.messages import topics
from tests.apps.monitor.test_watch import renderer, states
from tests.apps.monitor.watched import watched
from tests.common.perception.test_live import perception


class Viewer:
    """Remembers what it is shown."""

    def __init__(self) -> None:
        self.begun: queue.SimpleQueue[LiveMoment] = queue.SimpleQueue()
        self.shown: queue.SimpleQueue[LiveMoment] = queue.SimpleQueue()
        self.closed = False

    def begin(self, moment: LiveMoment, stamp_ns: int) -> None:
        self.begun.put(moment)

    def show(self, moment: LiveMoment, stamp_ns: int) -> None:
        self.shown.put(moment)

    def close(self) -> None:
        self.closed = True


def test_episode_under_way_comes_first(data: Path) -> None:
    run, watch = watched()
    subject = Subject("run", data=data)
    subject.watch = watch
    worker = renderer(run, watch)
    told = dataclasses.replace(perception(), episode=states(5)[2].episode)
    worker.tell(topics.PERCEPTION, told)
    worker.tell(topics.STATE, states(5)[2])
    viewer = Viewer()
    feed = Feed(subject, viewer)
    assert viewer.begun.get(timeout=20).state.episode.index == 5
    moment = viewer.shown.get(timeout=20)
    assert moment.state.sample == 2
    assert moment.perception.detections == told.detections
    feed.close()
    assert viewer.closed


def test_recorded_episodes_are_shown_where_none_is_under_way(data: Path, monkeypatch) -> None:
    monkeypatch.setattr("readygo.apps.monitor.feed.WAIT_S", 0.0)
    viewer = Viewer()
    feed = Feed(Subject("data", data=data), viewer)
    first, second = viewer.shown.get(timeout=20), viewer.shown.get(timeout=20)
    feed.close()
    assert (first.state.sample, second.state.sample) == (0, 2)
    assert first.images
    assert len(first.way) == 20
