import subprocess
import sys
from pathlib import Path

import pytest

FIRST = "import sys\nprint('first')\nclass Thing: ...\n"
THEN = "import first\nprint('then', first.Thing.__name__)\n"


@pytest.fixture
def said(tmp_path: Path):
    """What a fresh process prints that has the modules `first` and `then`."""
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "__init__.py").write_text(FIRST)
    (tmp_path / "first" / "data.txt").write_text("kept")
    (tmp_path / "then.py").write_text(THEN)

    def run(code: str) -> list[str]:
        begin = (
            f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from readygo.common.import_hook import import_after"
        )
        done = subprocess.run([sys.executable, "-c", f"{begin}\n{code}"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return run


def test_module_follows_one_that_is_imported_later_and_once(said):
    code = "import_after('first', 'then'); print('before'); import first; import first"
    assert said(code) == ["before", "first", "then Thing"]


def test_module_follows_one_that_is_already_imported_at_once(said):
    assert said("import first; import_after('first', 'then'); print('behind')") == ["first", "then Thing", "behind"]


def test_package_keeps_its_resources_and_the_hook_leaves_nothing_behind(said):
    code = """
before = list(sys.meta_path)
import_after("first", "then")
import first, importlib.resources
print(importlib.resources.files("first").joinpath("data.txt").read_text(), sys.meta_path == before)
print(type(first.__spec__.loader).__name__)
"""
    assert said(code) == ["first", "then Thing", "kept True", "SourceFileLoader"]


def test_missing_module_is_missing_as_without_the_hook(said):
    code = """
import_after("nowhere", "then")
try:
    import nowhere
except ModuleNotFoundError as error:
    print(error)
"""
    assert said(code) == ["No module named 'nowhere'"]
