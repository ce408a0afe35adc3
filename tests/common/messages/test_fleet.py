import msgpack
import pytest

from readygo.common.errors import MessageError
from readygo.common.messages.codec import decode, encode
from readygo.common.messages.fleet import FleetReply, HeldLease, WorkerState
from tests.common.messages.examples import message


@pytest.mark.parametrize(
    ("cls", "field", "value"),
    [
        (HeldLease, "stage", "\x1b[2J"),
        (WorkerState, "role", "\x1b[2J"),
        (WorkerState, "name", "\x1b[2J"),
        (WorkerState, "name", ""),
        (FleetReply, "stages", ["\x1b[2J"]),
        (FleetReply, "done_per_minute", {"\x1b[2J": 1.0}),
    ],
)
def test_names_that_steer_a_terminal_are_refused(cls: type, field: str, value: object) -> None:
    said = message(cls)
    assert decode(cls, encode(said)) == said
    with pytest.raises(MessageError, match=r"printable characters|must not be empty"):
        decode(cls, msgpack.packb(msgpack.unpackb(encode(said)) | {field: value}))


def test_worker_that_is_gone_has_no_role() -> None:
    WorkerState(role="", name="desk-1", silent_s=0.0, done=0, failed=0, holds=())
