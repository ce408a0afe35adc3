import pytest

from tests.mutants import places
from tests.mutants.conftest import commit


@pytest.fixture
def product(tree):
    return places.product_files(tree, places.tracked_files(tree))


def test_product_files_are_neither_tests_nor_packages(product):
    assert product == ["common/shop/alone.py", "common/shop/price.py", "common/shop/wait.py"]


def test_draw_is_a_function_of_the_seed_and_begins_alike(tree, product):
    lines = dict.fromkeys(product)
    draws = [places.draw(tree, lines, count, seed) for count, seed in ((5, 1), (5, 1), (3, 1), (5, 2))]
    assert draws[0] == draws[1]
    assert draws[0][:3] == draws[2]
    assert draws[0] != draws[3]


def test_each_line_with_a_change_is_drawn_once(tree, product):
    drawn = places.draw(tree, dict.fromkeys(product), 100, 1)
    assert len({(one.file, one.line) for one in drawn}) == len(drawn)
    assert {one.line for one in drawn if one.file.endswith("price.py")} == {5, 7, 8}


def test_changed_lines_are_those_of_the_working_tree(tree):
    path = tree / "common" / "shop" / "wait.py"
    path.write_text(path.read_text().replace("done += 1", "done += 2"))
    (tree / "common" / "new.py").write_text("A = 1\nB = A + 1\n")
    assert places.changed_lines(tree, "HEAD") == {"common/shop/wait.py": {4}, "common/new.py": {1, 2}}


def test_work_is_compared_with_where_it_left_main_or_with_the_commit_before(tree):
    first = places.git(tree, "rev-parse", "HEAD").strip()
    (tree / "a").touch()
    commit(tree, "Go on")
    assert places.git(tree, "rev-parse", places.default_base(tree)).strip() == first
    places.git(tree, "checkout", "-q", "-b", "side", first)
    (tree / "b").touch()
    commit(tree, "Beside")
    assert places.default_base(tree) == first


def test_known_changes_are_found_where_they_have_moved(tree, product):
    drawn = places.draw(tree, dict.fromkeys(product), 100, 1)
    path = tree / "common" / "shop" / "price.py"
    path.write_text("A = 0\n" + path.read_text())
    entries = [
        {name: getattr(one, name) for name in ("file", "function", "operator", "before", "after")} for one in drawn
    ]
    found = places.known(tree, entries)
    assert [one.key for one in found] == [one.key for one in drawn]
    assert [one.line - (one.file.endswith("price.py")) for one in found] == [one.line for one in drawn]
    assert places.known(tree, [{**entries[0], "before": "gone"}, {**entries[0], "file": "gone.py"}]) == []


def test_change_by_hand_is_found_by_its_text(tree):
    entry = {
        "file": "common/shop/price.py", "function": "total", "operator": places.HAND,
        "before": "result += price", "after": "result = price",
    }  # fmt: skip
    (one,) = places.known(tree, [entry])
    changed = one.apply((tree / one.file).read_bytes()).decode()
    assert "            result = price\n" in changed
    assert one.line == 8
    assert places.known(tree, [{**entry, "before": "price"}]) == []
