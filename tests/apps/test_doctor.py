import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps import doctor
from readygo.apps.doctor import examine


def found(data: Path) -> dict[str, doctor.Finding]:
    return {finding.name: finding for finding in examine(data)}


def test_this_machine_can_work(tmp_path: Path) -> None:
    findings = found(tmp_path / "not" / "there" / "yet")
    assert [name for name, finding in findings.items() if finding.good is False] == []
    assert str(tmp_path) in findings["disk of data"].text
    assert findings["numba"].text == importlib.metadata.version("numba")


def test_full_disk_must_be_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=10**8))
    assert found(tmp_path)["disk of data"].good is False


def test_missing_extra_is_named_with_its_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    finding = found(tmp_path)["extra train"]
    assert finding.good is None
    assert "pip install" in finding.text


def test_gpu_that_does_not_answer_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: "/bin/false")
    assert found(tmp_path)["GPU"].text == "nvidia-smi is there, but does not answer"


@pytest.mark.parametrize(("free", "good"), [(2_000_000_000, False), (2_000_000_001, True)])
def test_disk_needs_more_than_2_gigabytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, good: bool
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
    finding = found(tmp_path / "not" / "there")["disk of data"]
    assert (finding.good, finding.text) == (good, f"2.0 GB free at {tmp_path}")


def test_hardware_is_told_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {1, 2, 5})
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setattr(os, "sysconf", lambda name: {"SC_PHYS_PAGES": 3_000_000, "SC_PAGE_SIZE": 4096}[name])
    monkeypatch.setattr(doctor, "_gpu", lambda: "a GPU")
    cores, memory, simd, gpu = doctor._hardware()
    assert cores.text == "3 of 8 may be used; 3 workers at most are of use"
    assert (memory.text, gpu.text) == ("12.3 GB", "a GPU")
    assert {cores.good, memory.good, simd.good, gpu.good} == {None}


@pytest.mark.parametrize(
    ("features", "words"),
    [
        ({"avx512f": True, "avx2": True}, "avx512f (cpu)"),
        ({"avx512f": False, "avx2": True}, "avx2 (cpu)"),
        ({"neon": True}, "neon (cpu)"),
        ({}, "none of AVX2, AVX-512 and NEON: slow (cpu)"),
    ],
)
def test_widest_vectors_are_told(features: dict[str, bool], words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from llvmlite import binding

    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(binding, "get_host_cpu_name", lambda: "cpu")
    assert doctor._simd() == words


def test_all_gpus_are_told_and_none_where_there_is_no_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def run(command: list[str], **how: object) -> SimpleNamespace:
        asked.append((command, how))
        return SimpleNamespace(stdout="one, 8 GB\ntwo, 9 GB\n")

    monkeypatch.setattr(shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(subprocess, "run", run)
    assert doctor._gpu() == "one, 8 GB; two, 9 GB"
    assert asked[0][0] == ["/bin/nvidia-smi", "--query-gpu=name,memory.total,driver_version", "--format=csv,noheader"]
    assert asked[0][1] == {"capture_output": True, "text": True, "timeout": 10, "check": True}
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: SimpleNamespace(stdout="\n"))
    assert doctor._gpu() == "none"
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert doctor._gpu() == "none found (no nvidia-smi); everything works without one"


def test_ports_that_cannot_be_opened_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    refused: set[int] = set()

    class Socket:
        def __enter__(self) -> "Socket":
            return self

        def __exit__(self, *_: object) -> None: ...

        def bind(self, where: tuple[str, int]) -> None:
            assert where[0] == "127.0.0.1"
            if where[1] in refused:
                raise OSError(13, "Permission denied")

    monkeypatch.setattr(doctor.socket, "socket", Socket)
    assert doctor._ports() == (True, "can be opened; 7447 is free for --listen tcp/127.0.0.1:7447")
    refused.add(7447)
    assert doctor._ports() == (True, "can be opened; 7447 is in use, choose another for --listen")
    refused.add(0)
    assert doctor._ports() == (False, "none can be opened: Permission denied")


def test_packages_and_extras_are_told_with_their_versions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def version(package: str) -> str:
        if package in ("zenoh", "mcap", "torch"):
            raise importlib.metadata.PackageNotFoundError
        return f"1.2 of {package}"

    monkeypatch.setattr(importlib.metadata, "version", version)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "gsplat" else 1)
    findings = found(tmp_path)
    assert (findings["mcap"].good, findings["mcap"].text) == (False, "not installed; install readygo again")
    assert (findings["numpy"].good, findings["numpy"].text) == (True, "1.2 of numpy")
    assert findings["extra policy"] == doctor.Finding(
        "extra policy", True, "driving by a policy, evaluate: onnxruntime 1.2 of onnxruntime"
    )
    assert findings["extra train"].text == "train, learn: torch "
    assert findings["extra gpu"].good is None
    assert findings["readygo"].good
