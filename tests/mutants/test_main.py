import json

import pytest

from tests.mutants.__main__ import main


def test_run_reports_survivors_goes_on_and_is_held_against_a_baseline(tree, tmp_path, capsys):
    before = {path: path.read_bytes() for path in tree.rglob("*.py")}
    out = tmp_path / "report.json"
    options = ["--draw", "3", "--seed", "4", "--within", "common/shop/price.py", "--limit-s", "10", "--nice", "0"]
    assert main([*options, "--out", str(out), "--jobs", "2"], tree) == 0
    report = json.loads(out.read_text())
    assert len(report["mutants"]) == 3
    assert {path: path.read_bytes() for path in tree.rglob("*.py")} == before
    assert not (tree / ".pytest_cache").exists()

    # The last mutant is gone, as if the run had been interrupted; the others are not tried out once more.
    lost = report["mutants"].pop()
    report["mutants"][0]["cpu_s"] = 77.0
    out.write_text(json.dumps(report))
    assert main([*options, "--out", str(out)], tree) == 0
    again = json.loads(out.read_text())
    assert again["mutants"][0]["cpu_s"] == 77.0
    assert (again["mutants"][-1]["before"], again["mutants"][-1]["result"]) == (lost["before"], lost["result"])
    assert main([*options, "--seed", "5", "--out", str(out)], tree) == 2
    assert "another run" in capsys.readouterr().err

    (tree / "tests" / "common" / "shop" / "test_price.py").write_text("def test_total(): pass\n")
    (tree / "tests" / "apps" / "test_far.py").write_text("def test_far(): pass\n")
    known = ["--known", str(out), "--baseline", str(out), "--limit-s", "10", "--nice", "0"]
    assert main(known, tree) == 1
    assert "was killed before, survives now" in capsys.readouterr().err


def test_changed_lines_are_the_default(tree, capsys):
    path = tree / "common" / "shop" / "price.py"
    path.write_text(path.read_text().replace("result += price", "result += 1 * price"))
    assert main(["--diff", "HEAD", "--limit-s", "10", "--nice", "0"], tree) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("lines changed since HEAD, seed 0: 1 mutants")
    assert "common/shop/price.py:8" in printed


@pytest.mark.parametrize("option", ["--diff", "--draw", "--known", "--baseline", "--out", "--jobs", "--limit-s"])
def test_help_names_the_options(option, capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert option in capsys.readouterr().out
