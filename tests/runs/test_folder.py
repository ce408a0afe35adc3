import dataclasses
import re
from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import OnRejection
from readygo.common.messages.stages import ANIMATE, HUMAN_PLAN, RENDER, ROBOT_PLAN
from readygo.runs.config import RunConfig, load_run_config, resolved_sections
from readygo.runs.folder import TARGETS, RunFolder, check_new
from readygo.services.coordinator import Ledger
from tests.common.messages.run_specs import SPEC


def test_folder_that_was_begun_on_a_full_disk_can_be_used_again(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
        pass
    folder.check(SPEC)
    folder.save(SPEC, 3)
    assert folder.load() == (SPEC, 3)


def test_folder_with_other_outputs_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    plain, rich = (
        dataclasses.replace(
            SPEC, config=resolved_sections(load_run_config(None, keys={"renderer": {"outputs": names}}))
        )
        for names in (["rgb"], ["rgb", "depth"])
    )
    with folder.lock():
        folder.save(plain, 3)
        folder.ledger.touch()
    folder.check(plain)
    with pytest.raises(RunError, match=r"config \(renderer\) differ"):
        folder.check(rich)


def test_folder_of_a_later_version_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.lock():
        folder.save(dataclasses.replace(SPEC, config={"renderer": {"antigravity": True}}), 3)
        folder.ledger.touch()
    with pytest.raises(RunError, match=r"config \(.*renderer.*\) differ"):
        folder.check(dataclasses.replace(SPEC, config=resolved_sections(RunConfig())))


def test_folder_of_a_run_with_other_stages_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    kept = dataclasses.replace(ROBOT_PLAN, on_rejection=OnRejection.KEEP)
    other = dataclasses.replace(SPEC, stages=(HUMAN_PLAN, ANIMATE, kept, RENDER))
    with folder.lock():
        folder.save(other, 3)
        folder.ledger.touch()
    folder.check(other)
    with pytest.raises(RunError, match="holds data of another run: stages differ"):
        folder.check(SPEC)


def test_endpoint_is_known_while_a_fleet_is_at_work(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.lock(), folder.reachable("tcp/127.0.0.1:7447", "secret"):
        assert folder.fleet_endpoint() == ("tcp/127.0.0.1:7447", "secret")
        assert (folder.state / "endpoint").stat().st_mode & 0o077 == 0, "nobody else may read the token"
    with pytest.raises(RunError, match="No fleet is at work on"):
        folder.fleet_endpoint()


def test_start_that_failed_binds_nobody(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    other = dataclasses.replace(SPEC, seed=SPEC.seed + 1)
    with folder.lock():
        folder.save(other, 3)
    folder.check(SPEC)
    folder.ledger.touch()
    with pytest.raises(RunError, match="seed differ"):
        folder.check(SPEC)


def test_ledger_without_an_episode_binds_nothing_and_one_with_an_episode_does(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    other = dataclasses.replace(SPEC, seed=SPEC.seed + 1)
    with folder.lock():
        folder.save(other, 3)
    ledger = Ledger(folder.ledger)
    folder.check(SPEC)
    assert not folder.has_data
    ledger.open_episodes(1)
    with pytest.raises(RunError, match="seed differ"):
        folder.check(SPEC)
    ledger.close()
    assert folder.has_data


def test_what_is_no_recorded_data_is_kept_out_of_data_folders_and_files(tmp_path: Path) -> None:
    RunFolder(tmp_path / "new").check_other()
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
        folder.check_other()
    (folder.path / "shard-r0-00000.mcap").touch()
    with pytest.raises(RunError, match=r"^--out .*data holds recorded data; choose a new folder"):
        folder.check_other()
    RunFolder(folder.path / "inside").check_other()
    file = RunFolder(folder.path / "shard-r0-00000.mcap")
    for check in (file.check_other, lambda: file.check(SPEC)):
        with pytest.raises(RunError, match=r"^--out .*mcap is a file; choose a new folder"):
            check()


def test_folder_without_a_run_is_named_without_the_files_that_it_lacks(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r" holds no recorded run; record one with `readygo generate`\.$") as caught:
        RunFolder(tmp_path).load()
    assert "spec.msgpack" not in str(caught.value)


def test_run_has_one_coordinator(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with pytest.raises(RunError, match="holds no recorded run"), folder.lock_coordinator(patience_s=0.0):
        pass
    with folder.lock():
        folder.save(SPEC, 3)
    with (
        folder.lock_coordinator(patience_s=0.0),
        pytest.raises(RunError, match="Another coordinator is at work on"),
        folder.lock_coordinator(patience_s=0.2),
    ):
        pass
    with folder.lock_coordinator(patience_s=0.0):
        pass


def test_endpoint_that_is_no_text_is_none(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.state.mkdir()
    (folder.state / "endpoint").write_bytes(b"tcp/\xff\n")
    with pytest.raises(RunError, match="No fleet is at work"):
        folder.fleet_endpoint()


def test_state_of_a_run_is_its_owners_alone_and_becomes_so_when_it_is_resumed(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
        assert folder.state.stat().st_mode & 0o777 == 0o700
        folder.save(SPEC, 3)
    assert folder.path.stat().st_mode & 0o055, "shards can be read"
    folder.state.chmod(0o755)
    with folder.lock():
        assert folder.state.stat().st_mode & 0o777 == 0o700
    (folder.state / TARGETS).mkdir()
    with folder.lock():
        assert folder.state.stat().st_mode & 0o777 == 0o711, "Prometheus gets through to the targets"


@pytest.mark.parametrize("kept", [0, 10, 100])
def test_spec_that_is_cut_is_named(kept: int, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.lock():
        folder.save(SPEC, 3)
    spec = folder.state / "spec.msgpack"
    spec.write_bytes(spec.read_bytes()[:kept])
    folder.ledger.touch()
    named = rf"^{re.escape(str(spec))} is damaged: Payload of {kept} bytes is no RunSpec"
    with pytest.raises(RunError, match=named):
        folder.load()
    with pytest.raises(RunError, match=named):
        folder.check(SPEC)


def test_number_of_wanted_episodes_that_is_none_is_named(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.lock():
        folder.save(SPEC, 3)
    (folder.state / "wanted").write_text("")
    with pytest.raises(RunError, match=r"wanted is damaged: write the number of wanted episodes"):
        folder.load()


def test_folder_is_new_if_there_is_nothing_in_it_but_what_a_command_left_itself(tmp_path: Path) -> None:
    check_new(tmp_path / "none")
    check_new(tmp_path)
    (tmp_path / ".lock").write_text("")
    check_new(tmp_path, ".lock", "perceive")
    with pytest.raises(RunError, match="holds files of something else; choose an empty or new folder with --out"):
        check_new(tmp_path, "perceive")
