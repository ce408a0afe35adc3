"""The same bytes from AVX2 and AVX-512 machines, from any thread and process, and in any order of frames.

Other machines draw the same images.
"""

import hashlib
import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding
from numba import njit

from readygo.common.rasterizer.cpu import blend as cpu_blend
from readygo.common.rasterizer.warm import warm
from tests.common.rasterizer.cpu import frames_digest
from tests.common.rasterizer.processors import AVX2, PLAIN, ROOT, numpy_features_above_avx2


def digest(*arguments: int | str, **environment: str) -> str:
    paths = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    command = [sys.executable, str(Path(__file__).parent / "frames_digest.py"), *map(str, arguments)]
    run = subprocess.run(command, env=paths, cwd=ROOT, capture_output=True, text=True, check=True)
    return run.stdout.strip()


def one_by_one(order: list[int]) -> dict[int, str]:
    """Hash of each frame, drawn in this order by a rasterizer of its own."""
    frames = frames_digest.frames(frames_digest.packed_scenes(), order)
    return {number: hashlib.sha256(frame).hexdigest() for number, frame in zip(order, frames, strict=True)}


@pytest.fixture(scope="module")
def hashes() -> dict[int, str]:
    """Hash of each of six frames."""
    in_order = one_by_one(list(range(6)))
    assert len(set(in_order.values())) == 6
    return in_order


@pytest.mark.parametrize("order", [[5, 4, 3, 2, 1, 0], [3, 3, 0, 5, 0, 3], [2]])
def test_frames_have_the_same_bytes_in_any_order(hashes: dict[int, str], order: list[int]) -> None:
    assert one_by_one(order) == {number: hashes[number] for number in order}


def test_frames_have_the_same_bytes_in_another_process(hashes: dict[int, str]) -> None:
    assert digest(4, 1).split() == [hashes[4], hashes[1]]


def test_frames_have_the_same_bytes_on_any_number_of_threads(hashes: dict[int, str]) -> None:
    with ThreadPoolExecutor(3) as threads:
        drawn = list(threads.map(one_by_one, ([0, 3, 1, 4], [4, 2, 5, 0], [5, 1, 3, 2])))
    for part in drawn:
        assert part == {number: hashes[number] for number in part}


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="compares x86 instruction sets")
@pytest.mark.skipif(not binding.get_host_cpu_features().get("avx2", False), reason="this CPU has no AVX2")
def test_packs_frames_and_their_other_images_have_the_same_bytes_with_avx2_as_with_what_this_cpu_has() -> None:
    assert digest(**AVX2, NPY_DISABLE_CPU_FEATURES=numpy_features_above_avx2()) == digest()


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
    uncached = njit(error_model="numpy", _nrt=False)(cpu_blend.draw_slab.py_func)
    uncached.compile(cpu_blend.draw_slab.signatures[0])
    (code,) = uncached.inspect_llvm().values()
    code = re.sub("target triple = .*", f'target triple = "{target.triple}"', code)
    code = re.sub("target datalayout = .*", f'target datalayout = "{target.target_data}"', code)
    assembly = target.emit_assembly(binding.parse_assembly(code))
    called = re.findall(r"\bbl\s+(\S+)", assembly)
    assert assembly.count("fmla") > 5
    assert not [name for name in called if "fma" in name or "__" in name]
