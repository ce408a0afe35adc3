import threading
import time

import pytest

from readygo.apps.learn.background import Background
from readygo.common.errors import PolicyError
from tests.waiting import wait_for


def test_result_comes_once_and_then_there_is_room_for_more() -> None:
    with Background() as background:
        background.start(lambda check: 3)
        assert wait_for(background.result) == 3
        assert background.result() is None
        assert not background.busy
        background.start(lambda check: 4)
        assert wait_for(background.result) == 4


def test_error_of_the_work_is_raised_where_its_result_is_asked_for() -> None:
    def fails(check: object) -> int:
        raise PolicyError("no such policy")

    with Background() as background:
        background.start(fails)
        with pytest.raises(PolicyError, match="no such policy"):
            wait_for(background.result)


def test_work_ends_with_its_block() -> None:
    ended = threading.Event()

    def endless(check) -> int:
        try:
            while True:
                check()
                time.sleep(0.01)
        finally:
            ended.set()

    with Background() as background:
        background.start(endless)
        assert background.busy
    assert ended.is_set()
