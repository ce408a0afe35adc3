import subprocess
import sys
from pathlib import Path

import pytest

from tests.import_contracts import computed_imports, imports_by_string

ROOT = Path(__file__).resolve().parents[1]
MODULES = ("shop", "shop.high", "shop.high.table", "shop.low")


@pytest.mark.parametrize(
    ("source", "imported"),
    [
        ('COMMAND = ("shop.high.table:lay", "sets the table")', ["shop.high.table"]),
        ('importlib.import_module("shop.low")', ["shop.low"]),
        ('run(["-m", "shop.high.table"])', ["shop.high.table"]),
        ('"shop.high.table.Table"', ["shop.high.table"]),
        ('"""See shop.high.table for more."""', []),
        ('"shop.nowhere"', []),
        ('"somebody.else"', []),
        ('"shop"', []),
    ],
)
def test_strings_that_name_a_module_are_imports(source: str, imported: list[str]) -> None:
    assert [found.imported for found in imports_by_string(source, MODULES)] == imported


def test_computed_imports_are_found() -> None:
    source = 'import_module("shop.low")\nimportlib.import_module(name)\n__import__(f"shop.{name}")\n'
    source += 'import_module(".low", "shop")\n'
    assert list(computed_imports(source)) == [2, 3, 4]


def test_nobody_else_computes_what_to_import() -> None:
    files = [
        path for top in ("apps", "benchmarks", "common", "runs", "services") for path in (ROOT / top).rglob("*.py")
    ]
    found = [path.relative_to(ROOT).as_posix() for path in files if list(computed_imports(path.read_text()))]
    # The table of commands is handed to the first from above; the second imports what `readygo/__init__.py` names, once
    # Gymnasium is imported; what a package loads late stands in it as an import for type checkers, which is judged; the
    # last imports a method that a user names.
    known = ["apps/cli.py", "common/import_hook.py", "common/lazy.py", "services/evaluator/custom_method.py"]
    assert sorted(found) == known


@pytest.mark.parametrize(
    ("low", "kept"), [("", True), ('CLERK = "shop.high.table:lay"\n', False), ("import shop.high.table\n", False)]
)
def test_contract_is_broken_by_an_import_by_string(low: str, kept: bool, tmp_path: Path) -> None:
    for name, text in {"shop/__init__.py": "", "shop/low.py": low, "shop/high/__init__.py": ""}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "shop" / "high" / "table.py").write_text("def lay(): ...\n")
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    (tmp_path / ".importlinter").write_text(
        "[importlinter]\nroot_package = shop\ncontract_types =\n    layers: tests.import_contracts.Layers\n"
        "[importlinter:contract:1]\nname = high -> low\ntype = layers\nlayers =\n    shop.high\n    shop.low\n"
    )
    code = "from importlinter.cli import lint_imports; import sys; sys.exit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == (0 if kept else 1), done.stdout + done.stderr
    assert ("1 broken" in done.stdout) != kept
