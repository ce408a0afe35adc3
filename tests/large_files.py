"""Refuses files in git that belong elsewhere: `python tests/large_files.py` exits with 1 and names them."""

import subprocess
import sys
from pathlib import Path

LIMIT_BYTES = 2_000_000


def main() -> int:
    """Name every tracked file above the limit."""
    root = Path(__file__).resolve().parents[1]
    names = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, check=True).stdout
    large = [
        f"{name}: {(root / name).stat().st_size / 1e6:.1f} MB"
        for name in names.decode().split("\0")
        if name and (root / name).is_file() and (root / name).stat().st_size > LIMIT_BYTES
    ]
    sys.stdout.write("".join(f"{line}\n" for line in large))
    return 1 if large else 0


if __name__ == "__main__":
    sys.exit(main())
