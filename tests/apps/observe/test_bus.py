import contextlib
from collections.abc import Iterator

from readygo.apps.observe.bus import WatchedBus
from readygo.common.bus import InProcessBus
from readygo.common.messages import Command, ControlRequest, Verdict, VerdictStatus, topics


class Watcher:
    def __init__(self) -> None:
        self.seen: list[str] = []

    @contextlib.contextmanager
    def requesting(self, topic: str) -> Iterator[None]:
        self.seen.append(f"asks {topic}")
        yield

    @contextlib.contextmanager
    def handling(self, topic: str) -> Iterator[None]:
        self.seen.append(f"answers {topic}")
        yield


def test_requests_are_watched_on_both_sides() -> None:
    watcher, heard = Watcher(), []
    bus = WatchedBus(InProcessBus(), (watcher,), lambda topic, request, reply: heard.append((topic, reply.status)))
    bus.serve(topics.CONTROL, lambda request: Verdict(status=VerdictStatus.OK))
    assert bus.request(topics.CONTROL, ControlRequest(command=Command.PAUSE)).status is VerdictStatus.OK
    assert watcher.seen == ["asks ctl", "answers ctl"]
    assert heard == [("ctl", VerdictStatus.OK)]
    bus.close()
