"""Which tests belong to a module, the nearest first."""

import ast
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path, PurePosixPath

PACKAGE = "readygo"


class TestChoice:
    """Finds the tests of the modules of a tree."""

    __test__ = False

    def __init__(self, root: Path) -> None:
        self._root = root
        self._exports: dict[str, dict[str, str]] = {}

    def tests_of(self, file: str) -> list[str]:
        """Tests of a product file, as paths from the root.

        The mirrored test is first; then tests that import the module, those that import it through a helper of the
        tests, and the mirrored tests of modules that import it, each group by nearness.
        """
        module = _module_of(file)
        mirrored = _mirrored(file)
        direct = [test for test, names in self._imports.items() if module in names and _is_test(test)]
        helped = [test for test in self._imports if _is_test(test) and module in self._imports_of_helpers(test)]
        importers = (_mirrored(other) for other, names in self._product_imports.items() if module in names)
        found = dict.fromkeys([mirrored])
        for group in (direct, helped, importers):
            found |= dict.fromkeys(sorted(group, key=lambda test: (_distance(test, mirrored), test)))
        return [test for test in found if (self._root / test).is_file()]

    @cached_property
    def _imports(self) -> dict[str, frozenset[str]]:
        """Modules that each file of the tests imports itself, by its path."""
        files = sorted((self._root / "tests").rglob("*.py"))
        return {self._path(file): frozenset(self._modules(file)) for file in files}

    @cached_property
    def _product_imports(self) -> dict[str, frozenset[str]]:
        files = (
            file for top in ("common", "services", "runs", "apps") for file in sorted((self._root / top).rglob("*.py"))
        )
        return {self._path(file): frozenset(self._modules(file)) for file in files if file.name != "__init__.py"}

    def _imports_of_helpers(self, test: str) -> set[str]:
        """What the helpers of a test import: modules of the tests that it imports, and the nearest conftest."""
        waiting = [_path_of(name) for name in self._imports[test] if name.startswith("tests.")]
        waiting.append(f"{PurePosixPath(test).parent}/conftest.py")
        seen: set[str] = set()
        while waiting:
            helper = waiting.pop()
            if helper in self._imports and helper not in seen:
                seen.add(helper)
                waiting += [_path_of(name) for name in self._imports[helper] if name.startswith("tests.")]
        return {name for helper in seen for name in self._imports[helper]}

    def _path(self, file: Path) -> str:
        return file.relative_to(self._root).as_posix()

    def _modules(self, file: Path) -> Iterator[str]:
        """Modules whose names a file imports, followed through the packages that pass them on."""
        for node in ast.walk(ast.parse(file.read_bytes())):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                yield from (self._home(node.module, alias.name) for alias in node.names)

    def _home(self, module: str, name: str) -> str:
        """The module that `from module import name` gets the name from."""
        if (self._root / _path_of(f"{module}.{name}")).is_file() or self._is_package(f"{module}.{name}"):
            return f"{module}.{name}"
        if not self._is_package(module):
            return module
        origin = self._exported(module).get(name)
        return self._home(*origin.rsplit(":", 1)) if origin and origin != f"{module}:{name}" else module

    def _exported(self, package: str) -> dict[str, str]:
        """Where the names of a package are from, as module:name."""
        if package not in self._exports:
            self._exports[package] = {}
            source = self._root / _path_of(package).removesuffix(".py") / "__init__.py"
            for node in ast.walk(ast.parse(source.read_bytes())):
                if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                    for alias in node.names:
                        self._exports[package][alias.asname or alias.name] = f"{node.module}:{alias.name}"
        return self._exports[package]

    def _is_package(self, module: str) -> bool:
        return (self._root / _path_of(module).removesuffix(".py") / "__init__.py").is_file()


def _module_of(file: str) -> str:
    return f"{PACKAGE}.{file.removesuffix('.py').replace('/', '.')}"


def _path_of(module: str) -> str:
    """The file of a module of the tree; the package itself is a folder of links."""
    parts = module.split(".")
    return "/".join(parts[1:] if parts[0] == PACKAGE and len(parts) > 1 else parts) + ".py"


def _mirrored(file: str) -> str:
    path = PurePosixPath(file)
    return f"tests/{path.parent}/test_{path.name}"


def _is_test(path: str) -> bool:
    return PurePosixPath(path).name.startswith("test_")


def _distance(test: str, mirrored: str) -> int:
    """Folders that two paths do not share."""
    a, b = PurePosixPath(test).parts[:-1], PurePosixPath(mirrored).parts[:-1]
    shared = _shared(zip(a, b, strict=False))
    return len(a) + len(b) - 2 * shared


def _shared(pairs: Iterable[tuple[str, str]]) -> int:
    count = 0
    for one, other in pairs:
        if one != other:
            break
        count += 1
    return count
