"""`python -m readygo.benchmarks`: every benchmark that needs no files, one after the other, on the embedded scene."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COMMANDS = (
    ["-m", "readygo", "bench", "render"],
    ["-m", "readygo.benchmarks.rasterizer.backward"],
    ["-m", "readygo", "bench", "motion"],
    ["-m", "readygo.benchmarks.motion.smpl_fit"],
    ["-m", "readygo.benchmarks.recording.dataset"],
    ["-m", "readygo.benchmarks.fleet.rates"],
    ["-m", "readygo.benchmarks.policy.policy", "cost"],
    ["-m", "readygo", "bench", "plan", "--episodes", "50"],
)


def main() -> int:
    """Run the benchmarks; returns the first exit code that is not 0."""
    for command in COMMANDS:
        sys.stdout.write(f"\n$ python {' '.join(command)}\n")
        sys.stdout.flush()
        code = subprocess.run([sys.executable, *command], cwd=ROOT, check=False).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
