"""Entry point of the `readygo` command.

In a wheel, `common`, `services` and `apps` lie beside this file; in an editable install or a bare checkout they lie in
the project's root. Either way they are imported under their own names.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def project_root() -> Path:
    """The folder that holds `common`: this one in a wheel, two levels up in a checkout."""
    return HERE if (HERE / "common").is_dir() else HERE.parents[1]


def main() -> None:
    """Run `readygo`."""
    root = str(project_root())
    if root not in sys.path:
        sys.path.insert(0, root)
    from apps.cli import main as run

    run()


if __name__ == "__main__":
    main()
