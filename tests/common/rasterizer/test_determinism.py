"""The same bytes from AVX2 and AVX-512 machines, and from every process."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

ROOT = Path(__file__).parents[3]
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+lzcnt,+popcnt,+sse4.2"}


def digest(**environment: str) -> str:
    script = Path(__file__).parent / "frames_digest.py"
    paths = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    run = subprocess.run([sys.executable, str(script)], env=paths, cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares x86 instruction sets")
@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2", False), reason="this CPU has no AVX2")
def test_packs_frames_and_their_other_images_have_the_same_bytes_with_avx2_as_with_what_this_cpu_has() -> None:
    assert digest(**AVX2, NPY_DISABLE_CPU_FEATURES=_numpy_features_above_avx2()) == digest()


def _numpy_features_above_avx2() -> str:
    """NumPy's own dispatch is lowered as well, as far as this machine has more than AVX2."""
    wanted = {"AVX512F": "avx512f", "AVX512CD": "avx512cd", "AVX512_SKX": "avx512bw"}
    host = binding.get_host_cpu_features()
    return ",".join(name for name, feature in wanted.items() if host.get(feature, False))
