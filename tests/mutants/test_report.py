import json

import pytest

from tests.mutants.operators import Mutation
from tests.mutants.places import known
from tests.mutants.report import EQUIVALENTS, Report, fallen, key_of
from tests.mutants.trial import TestRun, Trial

HEADER = {"program": 1, "commit": "ab", "mode": "draw"}


def mutant(number):
    return Mutation(
        file="common/a.py", line=number, function="f", operator="sign", before=f"a{number}", after=f"-a{number}",
        begin=0, end=1, text="-",
    )  # fmt: skip


def report_of(results, path=None, equivalents=()):
    report = Report(HEADER, path, equivalents)
    for number, result in enumerate(results):
        report.add(mutant(number), Trial(result=result))
    return report


def test_timeouts_count_as_killed_and_equivalents_not_at_all():
    equivalent = {name: getattr(mutant(4), name) for name in ("file", "function", "operator", "before", "after")}
    report = report_of(
        ["killed", "timeout", "survived", "no test", "survived"],
        equivalents=[equivalent | {"reason": "rounds the same"}],
    )
    assert report.summary() == {
        "killed": 1, "timeout": 1, "survived": 1, "no test": 1, "equivalent": 1, "share_killed": 0.5,
    }  # fmt: skip
    assert report.entries[4]["equivalent"] == "rounds the same"


def test_interrupted_run_goes_on_where_its_file_ends(tmp_path):
    path = tmp_path / "report.json"
    first = report_of(["killed"], path)
    first.unchanged["tests/test_a.py"] = TestRun(verdict="passed", cpu_s=1.0)
    first.write()
    second = Report(HEADER, path)
    second.resume()
    assert second.has(mutant(0))
    assert not second.has(mutant(1))
    assert second.unchanged == first.unchanged
    assert [key_of(entry) for entry in second.entries] == [mutant(0).key]
    assert json.loads(path.read_text())["summary"]["killed"] == 1


def test_file_of_another_run_is_not_continued(tmp_path):
    report_of(["killed"], tmp_path / "report.json")
    with pytest.raises(ValueError, match=r"another run \(commit differ\)"):
        Report({**HEADER, "commit": "cd"}, tmp_path / "report.json").resume()


@pytest.mark.parametrize(
    ("results", "same", "words"),
    [
        (["killed", "timeout", "survived", "survived"], True, []),
        (["killed", "survived", "killed", "survived"], True, ["common/a.py:1: was killed before"]),
        (["survived", "survived", "survived", "survived"], True, ["a.py:0", "a.py:1", "0.0% of the mutants"]),
        (["killed", "timeout", "survived", "survived", "survived"], False, []),
    ],
)
def test_what_is_worse_than_before_is_named(results, same, words):
    before = report_of(["killed", "killed", "survived", "survived"])
    baseline = {"mutants": before.entries, "summary": before.summary()}
    lines = fallen(report_of(results), baseline, same=same)
    assert len(lines) == len(words)
    assert all(word in line for word, line in zip(words, lines, strict=True))


def test_reviewed_equivalents_have_a_reason_and_a_place_in_the_tree():
    root = EQUIVALENTS.parents[2]
    entries = json.loads(EQUIVALENTS.read_text())
    assert all(entry["reason"].endswith(".") for entry in entries)
    assert [one.key for one in known(root, entries)] == [key_of(entry) for entry in entries]
