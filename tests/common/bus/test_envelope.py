import pytest

from readygo.common.bus.envelope import TRACE, opened, seal


def test_without_a_trace_the_envelope_is_the_topic_s_name() -> None:
    assert seal("ctl/status") == b"ctl/status"
    with opened(b"ctl/status") as topic:
        assert (topic, TRACE.get()) == ("ctl/status", "")


def test_trace_travels_and_ends_with_the_request() -> None:
    before = TRACE.set("00-1-2-01")
    envelope = seal("blob")
    TRACE.reset(before)
    with opened(envelope) as topic:
        assert (topic, TRACE.get()) == ("blob", "00-1-2-01")
    assert TRACE.get() == ""


def test_trace_that_is_none_is_left_out() -> None:
    with opened(b"blob\n" + b"x" * 100) as topic:
        assert (topic, TRACE.get()) == ("blob", "")


@pytest.mark.parametrize(("length", "kept"), [(64, True), (65, False)])
def test_trace_of_64_characters_is_one_and_a_longer_one_is_none(length: int, kept: bool) -> None:
    with opened(b"blob\n" + b"x" * length):
        assert TRACE.get() == ("x" * length if kept else "")
    with opened("blob\n\u00e9".encode("latin-1")) as topic:
        assert (topic, TRACE.get()) == ("blob", "\ufffd")


def test_trace_of_the_thread_comes_back_also_after_a_failure() -> None:
    before = TRACE.set("outer")
    with pytest.raises(ZeroDivisionError), opened(b"blob\ninner"):
        raise ZeroDivisionError
    assert TRACE.get() == "outer"
    TRACE.reset(before)
