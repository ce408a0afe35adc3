"""The process of a worker: signals to end, a watchdog thread, and memory settings."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable

SILENT_S = 300.0
"""Time without processor time in its main thread after which a worker counts as hung and is ended [s]."""
LATE_S = 5.0
"""Time for a worker to end when its parent, and with it the router, is gone [s]."""


def keep_the_heap_small() -> None:
    """Return arrays above 256 kB to the system when they are freed; saves 30 MB per renderer.

    By default glibc retains them once the first array of such a size was freed.
    """
    with contextlib.suppress(OSError, AttributeError):
        # -3 is M_MMAP_THRESHOLD.
        ctypes.CDLL(None).mallopt(-3, 1 << 18)


def stop_signal(exit_with_parent: bool) -> threading.Event:
    """An event set by SIGTERM and, with `exit_with_parent`, by the end of standard input; that exits `LATE_S` later."""
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    if exit_with_parent:
        # Ctrl-C reaches the whole process group; only the parent decides what its fleet does.
        signal.signal(signal.SIGINT, signal.SIG_IGN)

        def watch_parent() -> None:
            # The raw descriptor: a daemon thread inside of a buffered read breaks the interpreter's shutdown.
            while os.read(0, 1):
                pass
            stop.set()
            # The parent, and with it the router, is gone: unfinished work has no receiver.
            late = threading.Timer(LATE_S, lambda: os._exit(1))
            late.daemon = True
            late.start()

        threading.Thread(target=watch_parent, name="parent", daemon=True).start()
    return stop


def _end_hung() -> None:
    sys.stderr.write(f"readygo: this worker hangs: it has done nothing for {SILENT_S:g} s.\n")
    sys.stderr.flush()
    os._exit(os.EX_SOFTWARE)


def watch_thread(
    watched: threading.Thread, *, silent_s: float = SILENT_S, end: Callable[[], object] = _end_hung
) -> None:
    """End the process if a thread has used no processor time for `silent_s` [s]: it hangs, even if other threads run.

    Threads that wait for work poll for it, which uses enough processor time.
    """
    clock = time.pthread_getcpuclockid(watched.ident or 0)

    def watch() -> None:
        taken_s, since_s = -1.0, time.monotonic()
        while watched.is_alive():
            time.sleep(silent_s / 10)
            try:
                now_s = time.clock_gettime(clock)
            except OSError:
                # It has ended meanwhile, and its clock with it.
                return
            if now_s > taken_s:
                taken_s, since_s = now_s, time.monotonic()
            elif time.monotonic() - since_s > silent_s:
                end()
                return

    threading.Thread(target=watch, name="watch", daemon=True).start()
