"""Lists modules without a test of their own: `python tests/mirror.py` exits with 1 if there are any.

The test of `common/x/y.py` is `tests/common/x/test_y.py`. None is asked of `__init__.py` and `__main__.py`, of
generated files (`*_pb2.py`), and of declarations: modules in which no function does anything, such as constants,
messages, protocols, and settings without checks.
"""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TOPS = ("common", "services", "runs", "apps", "benchmarks")


def main() -> int:
    """Print the modules without a test."""
    untested = [path for path in modules(ROOT) if not (ROOT / mirrored(path)).is_file()]
    sys.stderr.write("".join(f"{path.as_posix()}: has no test at {mirrored(path)}\n" for path in untested))
    return 1 if untested else 0


def modules(root: Path) -> list[Path]:
    """Modules that need a test, relative to `root`."""
    paths = sorted(path for top in TOPS for path in (root / top).rglob("*.py"))
    return [path.relative_to(root) for path in paths if not is_exempt(path.name, path.read_text())]


def is_exempt(name: str, source: str) -> bool:
    """True for files that need no test: see the top of this file."""
    if name in ("__init__.py", "__main__.py") or name.endswith("_pb2.py"):
        return True
    functions = (node for node in ast.walk(ast.parse(source)) if isinstance(node, (ast.FunctionDef, ast.Lambda)))
    return not any(does_something(node) for node in functions)


def does_something(function: ast.FunctionDef | ast.Lambda) -> bool:
    """False if a function's body is a docstring, `...` or `pass`."""
    if isinstance(function, ast.Lambda):
        return True
    return not all(
        isinstance(line, ast.Pass) or (isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant))
        for line in function.body
    )


def mirrored(module: Path) -> Path:
    """Where a module's test is."""
    return Path("tests") / module.parent / f"test_{module.name}"


if __name__ == "__main__":
    sys.exit(main())
