"""The same tree from AVX2 and AVX-512 machines."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

from tests.common.rasterizer.processors import AVX2, ROOT, numpy_features_above_avx2


def digest(**environment: str) -> str:
    paths = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    command = [sys.executable, str(Path(__file__).parent / "lod_digest.py")]
    run = subprocess.run(command, env=paths, cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares x86 instruction sets")
@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2", False), reason="this CPU has no AVX2")
def test_trees_have_the_same_bytes_with_avx2_as_with_what_this_cpu_has() -> None:
    assert digest(**AVX2, NPY_DISABLE_CPU_FEATURES=numpy_features_above_avx2()) == digest()
