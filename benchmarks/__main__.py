"""`python -m benchmarks`: every benchmark that needs no files, one after the other, on the embedded scene."""

import subprocess
import sys
from pathlib import Path

from apps.scene_argument import open_scene

HERE = Path(__file__).resolve().parent


def main() -> int:
    """Run the benchmarks; returns the first exit code that is not 0."""
    scene = str(open_scene("embedded").path)
    commands = (["render.py", scene], ["motion.py"], ["dataset.py"], ["policy.py", "cost"])
    for command in commands:
        sys.stdout.write(f"\n$ python benchmarks/{' '.join(command)}\n")
        sys.stdout.flush()
        code = subprocess.run([sys.executable, str(HERE / command[0]), *command[1:]], check=False).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
