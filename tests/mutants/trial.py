"""Runs the tests of changed files in a copy of the tree."""

import contextlib
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from readygo.common.files import cache_root
from tests.mutants.choice import TestChoice
from tests.mutants.operators import Mutation

WALL_PER_CPU, WALL_LEAST_S = 2.5, 300.0
"""Wall-clock limit of a run of tests, for those that wait for ever: in units of its processor time, and at least."""
MEMORY_BYTES = 8 << 30
_FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)
_DIGESTS = """
import json, pathlib
from readygo.common.kernels import sources_digest
files = [path for top in ("common", "services", "runs", "apps") for path in pathlib.Path("readygo", top).rglob("*.py")]
print(json.dumps({".".join(path.with_suffix("").parts): sources_digest(path.absolute()) for path in files}))
"""


@dataclass(frozen=True, kw_only=True)
class TestRun:
    """One run of one file of tests."""

    __test__ = False

    verdict: str
    """"passed", "failed" or "timeout"."""
    cpu_s: float
    """Processor time [s]."""
    failed: str = ""
    """The first test that failed."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What became of one change."""

    result: str
    """"killed", "timeout" (killed as well), "survived" or "no test"."""
    killed_by: str = ""
    """The test that failed."""
    tests: tuple[str, ...] = ()
    """Files of tests that ran, in their order."""
    cpu_s: float = 0.0
    """Processor time of these runs [s]."""


@dataclass
class Bench:
    """A copy of a tree in which files are changed one after the other.

    Every run gets an empty cache folder and machine code of unchanged modules alone: what a changed program writes
    there does not reach the next one.
    """

    folder: Path
    """Where the copy is, and all that its tests write; removed by `close`."""
    limit_s: float
    """Processor time for all tests of a change, and for each unchanged file of tests [s]."""
    tests_max: int
    """Files of tests for a change."""
    unchanged: dict[str, TestRun] = field(default_factory=dict)
    """Runs of tests in the unchanged tree, by file; kept and shared by all benches of a run."""

    def __post_init__(self) -> None:
        self.tree = self.folder / "tree"
        self._kernels = self.folder / "kernels"
        self._digests: dict[str, str] = {}
        self._process: subprocess.Popen[str] | None = None
        self._is_closed = False

    def set_up(self, root: Path, files: Iterable[str]) -> None:
        """Copy some files of a tree, and the machine code that its kernels have already."""
        for name in files:
            target = self.tree / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, target, follow_symlinks=False)
        self._choice = TestChoice(self.tree)
        # Compiled files that are found by their content: a change may keep size and time of its file.
        tops = [
            top for top in ("common", "services", "runs", "apps", "benchmarks", "tests") if (self.tree / top).is_dir()
        ]
        compileall = ("-m", "compileall", "-q", "--invalidation-mode", "checked-hash", *tops)
        subprocess.run((sys.executable, *compileall), cwd=self.tree, check=False)
        digests = subprocess.run(
            (sys.executable, "-c", _DIGESTS), cwd=self.tree, env=self._environment(), capture_output=True, check=False
        )
        self._digests = json.loads(digests.stdout) if digests.returncode == 0 else {}
        kept = Path(os.environ.get("NUMBA_CACHE_DIR") or cache_root() / "kernels")
        for module, digest in self._digests.items():
            if (kept / module / digest).is_dir():
                with contextlib.suppress(OSError):
                    shutil.copytree(kept / module / digest, self._kernels / module / digest)

    def close(self) -> None:
        """Stop what runs and remove the folder."""
        self._is_closed, process = True, self._process
        if process is not None and process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        shutil.rmtree(self.folder, ignore_errors=True)

    def try_out(self, mutation: Mutation) -> Trial:
        """Change a file, run its tests until one fails, and put the file back."""
        path = self.tree / mutation.file
        source, spent_s, ran = path.read_bytes(), 0.0, []
        for test in self._choice.tests_of(mutation.file)[: self.tests_max]:
            if spent_s >= self.limit_s:
                break
            if test in self.unchanged and self.unchanged[test].verdict != "passed":
                continue
            path.write_bytes(mutation.apply(source))
            try:
                run = self._run(test, self.limit_s)
            finally:
                path.write_bytes(source)
                self._forget_changed_kernels()
            spent_s += run.cpu_s
            if run.verdict != "passed" and not self._would_pass(test, path, run.verdict):
                continue
            ran.append(test)
            if run.verdict != "passed":
                result = "killed" if run.verdict == "failed" else "timeout"
                return Trial(result=result, killed_by=run.failed or test, tests=tuple(ran), cpu_s=round(spent_s, 1))
        return Trial(result="survived" if ran else "no test", tests=tuple(ran), cpu_s=round(spent_s, 1))

    def _would_pass(self, test: str, path: Path, verdict: str) -> bool:
        """True if a file of tests passes without the change; after a timeout kernels are compiled for it as well."""
        if test not in self.unchanged:
            self.unchanged[test] = self._run(test, self.limit_s)
        if self.unchanged[test].verdict != "passed" or verdict == "failed":
            return self.unchanged[test].verdict == "passed"
        source = path.read_bytes()
        path.write_bytes(source + b"\n# Another digest.\n")
        try:
            return self._run(test, self.limit_s).verdict == "passed"
        finally:
            path.write_bytes(source)
            self._forget_changed_kernels()

    def _run(self, test: str, limit_s: float) -> TestRun:
        """Run a file of tests until the first failure, in `limit_s` of processor time for each process."""
        written = self.folder / "written"
        shutil.rmtree(written, ignore_errors=True)
        written.mkdir()
        options = ("-x", "-q", "--tb=no", "-rfE", "-p", "no:cacheprovider", "--hypothesis-seed=0")

        log = written / "log"
        with log.open("w") as out:
            self._process = subprocess.Popen(
                (sys.executable, "-m", "pytest", *options, f"--basetemp={written / 'tmp'}", test),
                cwd=self.tree, env=self._environment(), stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
                text=True, start_new_session=True,
            )  # fmt: skip
            _set_limits(self._process.pid, int(limit_s))
            code, cpu_s = _wait(self._process, max(WALL_LEAST_S, WALL_PER_CPU * limit_s))
        if self._is_closed:
            raise InterruptedError
        text = log.read_text(errors="replace")
        failed = _FAILED.search(text)
        if code in (None, -signal.SIGXCPU, -signal.SIGKILL):
            return TestRun(verdict="timeout", cpu_s=cpu_s, failed=test)
        # 5: no test was found.
        verdict = "passed" if code in (0, 5) else "failed"
        return TestRun(
            verdict=verdict, cpu_s=cpu_s, failed=failed[1] if failed else "" if verdict == "passed" else test
        )

    def _environment(self) -> dict[str, str]:
        return os.environ | {
            "PYTHONPATH": str(self.tree),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(self._kernels),
            "XDG_CACHE_HOME": str(self.folder / "written" / "cache"),
            "HYPOTHESIS_STORAGE_DIRECTORY": str(self.folder / "written" / "hypothesis"),
            **{f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "NUMBA")},
        }

    def _forget_changed_kernels(self) -> None:
        for module, digest in self._digests.items():
            for state in (self._kernels / module).glob("*"):
                if state.name != digest:
                    shutil.rmtree(state, ignore_errors=True)


def _set_limits(pid: int, cpu_s: int) -> None:
    """Limit a process and those that it will start."""
    with contextlib.suppress(ProcessLookupError):
        resource.prlimit(pid, resource.RLIMIT_CPU, (cpu_s, cpu_s + 5))
        resource.prlimit(pid, resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))


def _wait(process: "subprocess.Popen[str]", limit_s: float) -> tuple[int | None, float]:
    """Exit code (None at the limit) and processor time [s] of a process and of those that it waited for."""
    end_s = time.monotonic() + limit_s
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            break
        if time.monotonic() > end_s:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            pid, status, usage = os.wait4(process.pid, 0)
            process.returncode = -signal.SIGKILL
            return None, round(usage.ru_utime + usage.ru_stime, 1)
        time.sleep(0.05)
    # What it left behind shall not run beside the next one.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, round(usage.ru_utime + usage.ru_stime, 1)
