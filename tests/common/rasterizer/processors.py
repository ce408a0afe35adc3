"""Processors that the same code must give the same bytes on."""

from pathlib import Path

from llvmlite import binding

ROOT = Path(__file__).parents[3]
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+lzcnt,+popcnt,+sse4.2"}
PLAIN = {"NUMBA_CPU_NAME": "x86-64", "NUMBA_CPU_FEATURES": "+sse2"}


def numpy_features_above_avx2() -> str:
    """NumPy's own dispatch is lowered as well, as far as this machine has more than AVX2."""
    wanted = {"AVX512F": "avx512f", "AVX512CD": "avx512cd", "AVX512_SKX": "avx512bw"}
    host = binding.get_host_cpu_features()
    return ",".join(name for name, feature in wanted.items() if host.get(feature, False))
