import dataclasses

from readygo.apps.fleet.roles import places
from readygo.common.messages import Stage
from tests.common.messages.run_specs import SPEC


def test_fleet_has_a_process_for_every_role_and_several_for_the_last_stage() -> None:
    assert places(SPEC, ("rec0", "rec1"), 2) == [
        ("coordinator", "coordinator"),
        ("recorder", "rec0"),
        ("recorder", "rec1"),
        ("human-planner", "human-planner0"),
        ("animator", "animator0"),
        ("robot-planner", "robot-planner0"),
        ("renderer", "renderer0"),
        ("renderer", "renderer1"),
    ]


def test_role_of_two_stages_is_one_worker() -> None:
    line = (Stage(name="a", role="painter"), Stage(name="b", role="painter"), Stage(name="c", role="cam", records=True))
    assert places(dataclasses.replace(SPEC, stages=line), ("rec0",), 1)[2:] == [
        ("painter", "painter0"),
        ("cam", "cam0"),
    ]


def test_workers_of_all_stages_take_the_place_of_the_others() -> None:
    assert places(SPEC, ("rec0",), 2, together=True) == [
        ("coordinator", "coordinator"),
        ("recorder", "rec0"),
        ("all", "all0"),
        ("all", "all1"),
    ]
