"""Lists modules without a test of their own: `python tests/mirror.py` exits with 1 if the list is not the known one.

The test of `common/x/y.py` is `tests/common/x/test_y.py`. None is asked of `__init__.py` and `__main__.py`, of
generated files (`*_pb2.py`), and of declarations: modules in which no function does anything, such as constants,
messages, protocols, and settings without checks. `tests/mirror_gaps.txt` has the known gaps, a line each: the module,
a colon, the reason.
"""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TOPS = ("common", "services", "runs", "apps", "benchmarks")
GAPS = ROOT / "tests" / "mirror_gaps.txt"


def main() -> int:
    """Print the modules without a test, and what is wrong with the list of them."""
    known = read_gaps(GAPS.read_text())
    untested = [path.as_posix() for path in modules(ROOT) if not (ROOT / mirrored(path)).is_file()]
    wrong = [f"{name}: has no test at {mirrored(Path(name))}" for name in untested if name not in known]
    wrong += [f"{name}: has a test, or is gone; take it off {GAPS.name}" for name in known if name not in untested]
    wrong += [f"{name}: needs a reason in {GAPS.name}" for name, reason in known.items() if not reason]
    listed = [f"{name}: {known[name]}" for name in untested if known.get(name)]
    sys.stdout.write("".join(f"{line}\n" for line in [*listed, f"{len(listed)} modules have no test of their own"]))
    sys.stderr.write("".join(f"{line}\n" for line in wrong))
    return 1 if wrong else 0


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


def read_gaps(text: str) -> dict[str, str]:
    """Known gaps and their reasons."""
    lines = (line.strip() for line in text.splitlines())
    pairs = (line.partition(":") for line in lines if line and not line.startswith("#"))
    return {name.strip(): reason.strip() for name, _, reason in pairs}


if __name__ == "__main__":
    sys.exit(main())
