import queue
import threading

from readygo.common.fleet.repeat import repeating


def test_act_is_done_on_a_thread_until_the_block_ends() -> None:
    threads: queue.SimpleQueue[str] = queue.SimpleQueue()
    with repeating(lambda: threads.put(threading.current_thread().name), every_s=0.001, name="pulse"):
        assert [threads.get(timeout=10.0) for _ in range(3)] == ["pulse"] * 3
    done = threads.qsize()
    assert not [thread for thread in threading.enumerate() if thread.name == "pulse"]
    assert threads.qsize() == done


def test_nothing_is_done_before_the_first_interval() -> None:
    done: list[int] = []
    with repeating(lambda: done.append(1), every_s=60.0, name="pulse"):
        pass
    assert done == []
