from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.runs.trained import check_out


def test_new_and_other_folders_are_let_pass(tmp_path: Path) -> None:
    (tmp_path / "report.html").touch()
    for resumes in (False, True):
        check_out(tmp_path, resumes=resumes)
        check_out(tmp_path / "new", resumes=resumes)


def test_file_and_recorded_data_are_refused(tmp_path: Path) -> None:
    (tmp_path / "shard-r0-00000.mcap").touch()
    with pytest.raises(RunError, match="holds recorded data"):
        check_out(tmp_path)
    with pytest.raises(RunError, match="is a file"):
        check_out(tmp_path / "shard-r0-00000.mcap", resumes=True)


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("policy.toml", "a policy"),
        ("state_policy.toml", "a policy on states"),
        ("perception.toml", "a network of perception"),
    ],
)
def test_trained_artifact_is_refused_unless_its_training_resumes(name: str, what: str, tmp_path: Path) -> None:
    (tmp_path / name).touch()
    with pytest.raises(RunError, match=rf"holds {what} \({name}\) without checkpoint\.pt: copy that too to resume, or"):
        check_out(tmp_path, resumes=True)
    (tmp_path / "checkpoint.pt").touch()
    check_out(tmp_path, resumes=True)
    with pytest.raises(RunError, match=rf"holds {what} \({name}\); choose a new folder\.$"):
        check_out(tmp_path)
