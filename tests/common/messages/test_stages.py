import dataclasses

import pytest

from readygo.common.messages.stages import DRIVE_LINE, EXPERT_LINE, RENDER, ROBOT_PLAN, OnRejection, Stage, check_stages

FIRST = Stage(name="a", role="r")
LAST = Stage(name="z", role="r", needs=("a",), records=True)


def test_lines_of_any_length_are_lines() -> None:
    check_stages(EXPERT_LINE)
    check_stages(DRIVE_LINE)
    check_stages((FIRST, LAST))
    check_stages((dataclasses.replace(LAST, needs=()),))


@pytest.mark.parametrize(
    ("stages", "message"),
    [
        ((), "Exactly the last stage of a line must record"),
        ((FIRST,), "Exactly the last stage"),
        ((dataclasses.replace(FIRST, records=True), LAST), "Exactly the last stage"),
        ((FIRST, dataclasses.replace(LAST, on_rejection=OnRejection.KEEP)), "'z' records: what it rejects cannot"),
        ((FIRST, FIRST, LAST), "different names of a-z, 0-9 and -, got 'a'"),
        ((FIRST, dataclasses.replace(FIRST, name="b/c"), LAST), "different names of a-z, 0-9 and -, got 'b/c'"),
        ((FIRST, dataclasses.replace(FIRST, name="rec"), LAST), "got 'rec'"),
        ((LAST,), "'z' needs 'a', which is no earlier stage"),
        ((*EXPERT_LINE[:2], dataclasses.replace(ROBOT_PLAN, needs=("render",)), RENDER), "needs 'render', which"),
    ],
)
def test_what_is_no_line_is_refused(stages: tuple[Stage, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check_stages(stages)
