import threading

from readygo.common.bus.inbox import INBOX_MAX, Inbox, Mailbox


def test_jobs_are_done_in_order_on_one_thread() -> None:
    inbox = Inbox()
    done: list[tuple[int, int]] = []
    for number in range(50):
        inbox.put(lambda number=number: done.append((number, threading.get_ident())))
    inbox.close()
    assert [number for number, _ in done] == list(range(50))
    assert len({thread for _, thread in done} | {threading.get_ident()}) == 2


def test_job_that_fails_does_not_cost_the_next_one() -> None:
    inbox = Inbox()
    done: list[str] = []
    inbox.put(lambda: 1 // 0)
    inbox.put(lambda: done.append("next"))
    inbox.close()
    assert done == ["next"]


def test_oldest_messages_make_room_while_the_handler_is_behind() -> None:
    inbox = Inbox()
    open_gate, inside = threading.Event(), threading.Event()
    taken: list[int] = []

    def handler(number: int) -> None:
        inside.set()
        open_gate.wait(5.0)
        taken.append(number)

    mailbox: Mailbox[int] = Mailbox(inbox, handler)
    mailbox.put(0)
    assert inside.wait(5.0)
    for number in range(1, 101):
        mailbox.put(number)
    open_gate.set()
    while len(taken) < 1 + INBOX_MAX:
        inbox.put(lambda: None)
    inbox.close()
    assert taken == [0, *range(101 - INBOX_MAX, 101)]


def test_busy_stream_lets_other_jobs_in_between() -> None:
    inbox = Inbox()
    order: list[str] = []
    first = threading.Event()
    inbox.put(lambda: first.wait(5.0) and None)
    mailbox: Mailbox[str] = Mailbox(inbox, order.append)
    for _ in range(3):
        mailbox.put("message")
    inbox.put(lambda: order.append("request"))
    first.set()
    while len(order) < 4:
        pass
    inbox.close()
    assert order == ["message", "request", "message", "message"]
