import pytest

from tests.mutants import places
from tests.mutants.operators import find_mutations
from tests.mutants.trial import Bench


@pytest.fixture
def bench(tree, tmp_path):
    bench = Bench(tmp_path / "bench", limit_s=5.0, tests_max=4)
    bench.set_up(tree, places.tracked_files(tree))
    yield bench
    bench.close()
    assert not bench.folder.exists()


def mutation(tree, file, after):
    (one,) = [one for one in find_mutations(file, (tree / file).read_bytes()) if one.after == after]
    return one


def test_test_that_notices_kills_and_the_file_is_put_back(bench, tree):
    change = mutation(tree, "common/shop/price.py", "result -= price")
    trial = bench.try_out(change)
    assert (trial.result, trial.killed_by) == ("killed", "tests/common/shop/test_price.py::test_total")
    assert trial.tests == ("tests/common/shop/test_price.py",)
    assert (bench.tree / change.file).read_bytes() == (tree / change.file).read_bytes()


def test_change_that_no_test_notices_survives_all_of_them(bench, tree):
    trial = bench.try_out(mutation(tree, "common/shop/price.py", "if price <= limit:"))
    assert trial.result == "survived"
    assert trial.tests == ("tests/common/shop/test_price.py", "tests/apps/test_far.py")


def test_endless_loop_is_a_timeout(bench, tree):
    trial = bench.try_out(mutation(tree, "common/shop/wait.py", "done -= 1"))
    assert (trial.result, trial.killed_by) == ("timeout", "tests/common/shop/test_wait.py")


def test_test_that_fails_without_the_change_does_not_count(bench, tree):
    path = bench.tree / "tests" / "common" / "shop" / "test_wait.py"
    path.write_text(path.read_text() + "    assert False\n")
    (bench.tree / "tests" / "apps" / "test_far.py").unlink()
    trial = bench.try_out(mutation(tree, "common/shop/wait.py", "while done <= count:"))
    assert (trial.result, trial.tests) == ("no test", ())
    assert bench.unchanged["tests/common/shop/test_wait.py"].verdict == "failed"
    again = bench.try_out(mutation(tree, "common/shop/wait.py", "done -= 1"))
    assert (again.result, again.cpu_s) == ("no test", 0.0)


def test_module_without_tests_has_none_to_run(bench, tree):
    assert bench.try_out(mutation(tree, "common/shop/alone.py", "return 2 / number")).result == "no test"
