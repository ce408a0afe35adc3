"""Names of a package that are loaded when they are first used.

Settings and messages lie beside algorithms that take a second to load; a process that needs the one does without the
other.
"""

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence


def lazy_names(package: str, names: Mapping[str, Sequence[str]]) -> Callable[[str], object]:
    """A `__getattr__` for a package.

    Args:
        package: Its `__name__`.
        names: Its public names, by the module that each is loaded from; modules that begin with a dot are below it.
    """
    home = {name: module for module, members in names.items() for name in members}

    def load(name: str) -> object:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(home[name], package), name)
        setattr(sys.modules[package], name, value)
        return value

    return load
