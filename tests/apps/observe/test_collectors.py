from pathlib import Path

from readygo.apps.fleet.fleet import Member
from readygo.apps.observe.collectors import of_coordinator, of_launcher
from tests.services.coordinator.line import Line


def test_stages_without_episodes_and_roles_without_workers_are_zero(tmp_path: Path) -> None:
    line = Line(tmp_path)
    rows = {(name, *labels.values()): value for name, _, labels, value in of_coordinator(line.coordinator)()}
    assert rows["readygo_episodes_waiting", "human-plan"] == 3
    assert rows["readygo_episodes_waiting", "render"] == 0
    assert rows["readygo_workers", "renderer"] == 0
    line.coordinator.troubles["rec0"] = "No space left."
    rows = {(name, *labels.values()): value for name, _, labels, value in of_coordinator(line.coordinator)()}
    assert rows["readygo_run_trouble",] == 1
    line.coordinator.ledger.close()


def test_members_that_come_later_are_shown(tmp_path: Path) -> None:
    members = [Member(role="renderer", name="renderer0", log=tmp_path, restarts=2)]
    rows = of_launcher(members)
    members.append(Member(role="renderer", name="renderer1", log=tmp_path))
    assert [(labels["member"], value) for _, _, labels, value in rows()] == [("renderer0", 2), ("renderer1", 0)]
