import copy
import dataclasses
import sys
from pathlib import Path

import pytest

from readygo.apps.cli import main
from readygo.apps.commands.generate import make_spec, record, with_outputs
from readygo.apps.commands.scene_argument import open_scene
from readygo.apps.run.config import RunConfig, RunFolder, resolved_sections, run_name
from readygo.apps.run.world import World
from readygo.common.config import section_from_mapping
from readygo.common.errors import RunError
from readygo.common.messages import RunSpec, Split
from readygo.services.coordinator import Ledger

SPEC = RunSpec(
    run="run-test",
    scene_path="scene",
    scene_hash="0",
    scene_files=(),
    avatars_path="",
    avatar_hashes={},
    seed=5,
    split=Split.TRAIN,
    static=False,
    config={},
    metadata={},
)


def test_folder_that_was_begun_on_a_full_disk_can_be_used_again(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "data")
    with folder.locked():
        pass
    folder.check(SPEC)
    folder.save(SPEC, 3)
    assert folder.load() == (SPEC, 3)


def test_second_process_changes_nothing_in_the_folder_of_a_running_one(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.locked():
        folder.save(SPEC, 3)
        with pytest.raises(RunError, match="Another process is generating"):
            record(SPEC, tmp_path, episodes=7, workers=0)
    assert folder.load() == (SPEC, 3)


def test_run_cannot_be_made_shorter_than_what_is_recorded(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.locked():
        folder.save(SPEC, 5)
    ledger = Ledger(folder.ledger)
    ledger.open_episodes(5)
    ledger.commit(0, "rec0", "shard", 10)
    ledger.commit(3, "rec0", "shard", 10)
    ledger.close()
    with pytest.raises(RunError, match=r"holds 2 episodes already.* at least 4 with --episodes"):
        record(SPEC, tmp_path, episodes=3, workers=0)
    assert folder.load() == (SPEC, 5)


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_seed_that_cannot_be_recorded_is_refused(seed: int) -> None:
    with pytest.raises(RunError, match="--seed must be"):
        make_spec(open_scene("embedded"), None, RunConfig(), seed=seed, split=Split.TRAIN, static=True)


def test_folder_of_a_version_without_some_setting_can_be_gone_on_with(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    ours = dataclasses.replace(SPEC, config=resolved_sections(RunConfig()))
    theirs = dataclasses.replace(SPEC, config=copy.deepcopy(ours.config))
    del theirs.config["renderer"]["outputs"]
    with folder.locked():
        folder.save(theirs, 3)
    folder.check(ours)


def test_folder_with_a_setting_that_is_gone_can_be_gone_on_with(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    ours = dataclasses.replace(SPEC, config=resolved_sections(RunConfig()))
    theirs = dataclasses.replace(SPEC, config=copy.deepcopy(ours.config))
    theirs.config["episode"]["human_height_m"] = 1.9
    with folder.locked():
        folder.save(theirs, 3)
    folder.check(ours)
    assert World(theirs).config == RunConfig()


def test_folder_from_before_there_were_labels_is_refused_but_with_labels_off(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with_labels = RunConfig()
    without = dataclasses.replace(with_labels, renderer=dataclasses.replace(with_labels.renderer, labels=False))
    old = dataclasses.replace(SPEC, config=copy.deepcopy(resolved_sections(with_labels)))
    del old.config["renderer"]["labels"]
    with folder.locked():
        folder.save(old, 3)
    folder.check(dataclasses.replace(SPEC, config=resolved_sections(without)))
    with pytest.raises(RunError, match=r"config \(renderer\) differ"):
        folder.check(dataclasses.replace(SPEC, config=resolved_sections(with_labels)))


def test_folder_with_other_outputs_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    plain, rich = (
        dataclasses.replace(SPEC, config=resolved_sections(with_outputs(RunConfig(), names)))
        for names in ("rgb", "rgb,depth")
    )
    with folder.locked():
        folder.save(plain, 3)
    folder.check(plain)
    with pytest.raises(RunError, match=r"config \(renderer\) differ"):
        folder.check(rich)


def test_folder_of_a_later_version_is_refused(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with folder.locked():
        folder.save(dataclasses.replace(SPEC, config={"renderer": {"antigravity": True}}), 3)
    with pytest.raises(RunError, match=r"config \(.*renderer.*\) differ"):
        folder.check(dataclasses.replace(SPEC, config=resolved_sections(RunConfig())))


def test_outputs_of_the_command_line_become_settings() -> None:
    config = with_outputs(RunConfig(), "mask, rgb,depth")
    assert config.renderer.outputs == ("rgb", "depth", "mask")
    sections = resolved_sections(config)
    assert sections["renderer"]["outputs"] == ["rgb", "depth", "mask"]
    assert section_from_mapping(RunConfig, sections) == config
    assert run_name(dataclasses.replace(SPEC, config=sections)) != run_name(
        dataclasses.replace(SPEC, config=resolved_sections(RunConfig()))
    )


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("rgb,thermal", "--outputs must be of rgb, depth, median_depth, alpha, mask, normal, got 'thermal'."),
        ("depth,mask", "--outputs must hold rgb, got depth, mask; add it."),
        ("rgb,,depth", "--outputs must be of rgb, depth, median_depth, alpha, mask, normal, got ''."),
    ],
)
def test_wrong_outputs_exit_with_2_and_one_line(names: str, message: str, capsys, monkeypatch, tmp_path: Path) -> None:
    arguments = ["generate", "embedded", "--out", str(tmp_path / "data"), "--outputs", names]
    monkeypatch.setattr(sys, "argv", ["readygo", *arguments])
    with pytest.raises(SystemExit) as exit_info:
        main()
    assert exit_info.value.code == 2
    assert capsys.readouterr().err == f"readygo: {message}\n"
    assert not (tmp_path / "data").exists()
