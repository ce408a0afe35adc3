"""The same bytes from AVX2 and AVX-512 machines and from every process; other machines draw the same images."""

import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding
from numba import njit

from common.rasterizer import cpu_blend
from common.rasterizer.warm import warm

ROOT = Path(__file__).parents[3]
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+lzcnt,+popcnt,+sse4.2"}


PLAIN = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "+sse2"}


def digest(*arguments: str, **environment: str) -> str:
    script = Path(__file__).parent / "frames_digest.py"
    paths = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    command = [sys.executable, str(script), *arguments]
    run = subprocess.run(command, env=paths, cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares x86 instruction sets")
@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2", False), reason="this CPU has no AVX2")
def test_packs_frames_and_their_other_images_have_the_same_bytes_with_avx2_as_with_what_this_cpu_has() -> None:
    assert digest(**AVX2, NPY_DISABLE_CPU_FEATURES=_numpy_features_above_avx2()) == digest()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares x86 instruction sets")
def test_plain_x86_64_draws_the_same_images_but_for_rounding(tmp_path: Path) -> None:
    digest(str(tmp_path / "plain.npy"), **PLAIN)
    digest(str(tmp_path / "host.npy"))
    plain, host = np.load(tmp_path / "plain.npy"), np.load(tmp_path / "host.npy")
    assert host.std() > 0.05
    assert np.quantile(np.abs(plain - host), 0.999) < 1e-4
    assert float(((plain - host) ** 2).mean()) < 1e-6


def test_kernels_compile_for_arm64_with_its_own_fused_multiply_adds() -> None:
    warm()
    binding.initialize_all_targets()
    binding.initialize_all_asmprinters()
    target = binding.Target.from_triple("aarch64-unknown-linux-gnu").create_target_machine(opt=2)
    uncached = njit(error_model="numpy", _nrt=False)(cpu_blend.blend_tiles.py_func)
    uncached.compile(cpu_blend.blend_tiles.signatures[0])
    (code,) = uncached.inspect_llvm().values()
    code = re.sub("target triple = .*", f'target triple = "{target.triple}"', code)
    code = re.sub("target datalayout = .*", f'target datalayout = "{target.target_data}"', code)
    assembly = target.emit_assembly(binding.parse_assembly(code))
    called = re.findall(r"\bbl\s+(\S+)", assembly)
    assert assembly.count("fmla") > 5
    assert not [name for name in called if "fma" in name or "__" in name]


def _numpy_features_above_avx2() -> str:
    """NumPy's own dispatch is lowered as well, as far as this machine has more than AVX2."""
    wanted = {"AVX512F": "avx512f", "AVX512CD": "avx512cd", "AVX512_SKX": "avx512bw"}
    host = binding.get_host_cpu_features()
    return ",".join(name for name, feature in wanted.items() if host.get(feature, False))
