"""Modules that are imported after a module of another package, whenever that is."""

import importlib
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType


def import_after(first: str, then: str) -> None:
    """Import a module as soon as another one is imported; at once if it already is.

    Args:
        first: A module at the top level, which need not be installed.
        then: The module that follows it.
    """
    if first in sys.modules:
        importlib.import_module(then)
    else:
        sys.meta_path.insert(0, _Follower(first, then))


class _Follower(MetaPathFinder):
    """Finds one module as all others do, with a loader that imports another module behind it."""

    def __init__(self, first: str, then: str) -> None:
        self._first, self._then = first, then

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of the first module; None for all others."""
        if fullname != self._first:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(fullname)
        if spec is not None and spec.loader is not None:
            spec.loader = _FollowedLoader(spec.loader, self._then)
        return spec


class _FollowedLoader(Loader):
    def __init__(self, loader: Loader, then: str) -> None:
        self._loader, self._then = loader, then

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """The new module, as its loader creates it."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Load the module, then import the one that follows it."""
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        importlib.import_module(self._then)
