import dataclasses
from types import SimpleNamespace

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import RunError
from readygo.common.fleet import StageResult
from readygo.common.messages import Stage, TeacherKind, TeacherRef
from readygo.common.messages.stages import DRIVE_LINE, EVALUATE, EXPERT_LINE
from readygo.common.perception.noise import PERCEIVED
from readygo.runs.stages import LINE, Entry, _labels, stage_works
from readygo.runs.world import World
from tests.common.messages.run_specs import SPEC

STAGES = (
    Stage(name="sketch", role="painter"),
    Stage(name="paint", role="painter"),
    Stage(name="film", role="camera", records=True),
)


def _works(role: str = "", stages: tuple[Stage, ...] = STAGES) -> list[tuple[str, bytes]]:
    """The stages in the order of their works, and what each work makes."""
    line = [
        Entry(stage=stage, work=lambda world, bus, stage=stage: lambda *_: StageResult(result=stage.name.encode()))
        for stage in STAGES
    ]
    world = World(dataclasses.replace(SPEC, stages=stages))
    works = stage_works(world, InProcessBus(), role, line)
    return [(stage.name, work(None, {}).result) for stage, work in works.items()]


def test_later_stages_come_first_and_have_their_own_works() -> None:
    assert _works() == [("film", b"film"), ("paint", b"paint"), ("sketch", b"sketch")]


def test_role_does_all_its_stages_and_no_others() -> None:
    assert _works("painter") == [("paint", b"paint"), ("sketch", b"sketch")]


def test_role_without_a_stage_is_told_which_ones_there_are() -> None:
    with pytest.raises(RunError, match="nothing to do for a 'juggler'; its stages need: painter, camera"):
        _works("juggler")


def test_run_may_leave_stages_out() -> None:
    assert _works(stages=STAGES[1:]) == [("film", b"film"), ("paint", b"paint")]


def test_table_knows_every_stage_of_the_lines_once() -> None:
    stages = [entry.stage for entry in LINE]
    assert set(stages) == {*EXPERT_LINE, *DRIVE_LINE, EVALUATE}
    assert len(set(stages)) == len(stages)


def test_expert_labels_unless_the_run_names_the_one_among_tracked_people() -> None:
    planner = SimpleNamespace(
        expert=lambda scenario, motions: ("expert", scenario, motions),
        detecting_expert=lambda scenario, noise: ("tracked", scenario, noise),
    )
    episode, made = SimpleNamespace(scenario="s", motions="m"), []
    for teacher in (None, TeacherRef(path="", files=(), kind=TeacherKind.EXPERT_TRACKED)):
        world = World(dataclasses.replace(SPEC, teacher=teacher))
        world.__dict__["robot_planner"] = planner
        made.append(_labels(world)(episode))  # type: ignore[arg-type]
    assert made == [("expert", "s", "m"), ("tracked", "s", PERCEIVED)]
