"""The same sensor images from AVX2 and AVX-512 machines, and from every process."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

ROOT = Path(__file__).parents[3]
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+lzcnt,+popcnt,+sse4.2"}
ABOVE_AVX2 = {"AVX512F": "avx512f", "AVX512CD": "avx512cd", "AVX512_SKX": "avx512bw"}


def digest(**environment: str) -> str:
    script = Path(__file__).parent / "sensor_digest.py"
    paths = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    run = subprocess.run([sys.executable, str(script)], env=paths, cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares x86 instruction sets")
@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2", False), reason="this CPU has no AVX2")
def test_sensor_gives_the_same_bytes_with_avx2_as_with_what_this_cpu_has() -> None:
    host = binding.get_host_cpu_features()
    lowered = ",".join(name for name, feature in ABOVE_AVX2.items() if host.get(feature, False))
    assert digest(**AVX2, NPY_DISABLE_CPU_FEATURES=lowered) == digest()
