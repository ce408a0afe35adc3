from pathlib import Path

from readygo.common.dataset.aside import read_set_aside
from readygo.common.messages import HumanPlanReply, Scenario, encode
from readygo.runs.aside import keep_scenario, note_set_aside
from readygo.runs.folder import RunFolder
from tests.common.messages.examples import KEY, message


def test_reason_and_scenario_of_an_episode_that_was_given_up_are_kept(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    reply = HumanPlanReply(episode=KEY, scenario=message(Scenario))
    words = keep_scenario(folder, 3, "stage render failed", {"human-plan": encode(reply)})
    place = folder.aside / "episode-000003.toml"
    assert words == f" (its scenario: {place})"
    assert place.with_suffix(".txt").read_text() == "stage render failed\n"
    assert "start_m = [0.0, 1.0]" in place.read_text()


def test_episode_without_a_scenario_that_can_be_read_keeps_its_reason(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    for results in ({}, {"human-plan": b"garbage"}, {"human-plan": encode(HumanPlanReply(episode=KEY))}):
        assert keep_scenario(folder, 3, "it failed", results) == ""
    assert [path.name for path in folder.aside.iterdir()] == ["episode-000003.txt"]


def test_dataset_names_the_episodes_that_were_given_up_until_there_are_none(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    note_set_aside(folder, {7: "no floor", 3: "it failed"})
    assert read_set_aside(tmp_path) == {3: "it failed", 7: "no floor"}
    note_set_aside(folder, {})
    note_set_aside(folder, {})
    assert read_set_aside(tmp_path) == {}
