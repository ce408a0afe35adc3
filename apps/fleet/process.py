"""The process of a worker: how it is told to end, and what it sees to beside its work."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable

SILENT_S = 300.0
"""A worker whose main thread takes no processor time for so long hangs, and is ended [s]."""
LATE_S = 5.0
"""Time that a worker has to end when its parent is gone, and with it the router [s]."""


def keep_the_heap_small() -> None:
    """Have arrays above 256 kB return to the system when they are freed: 30 MB of every renderer.

    By default glibc keeps them for later from the first freed array of such a size on.
    """
    with contextlib.suppress(OSError, AttributeError):
        # -3 is M_MMAP_THRESHOLD.
        ctypes.CDLL(None).mallopt(-3, 1 << 18)


def stop_signal(exit_with_parent: bool) -> threading.Event:
    """What SIGTERM sets, and with `exit_with_parent` the end of standard input: `LATE_S` later the process is ended."""
    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    if exit_with_parent:
        # Ctrl-C reaches the whole process group; the parent alone decides what its fleet does then.
        signal.signal(signal.SIGINT, signal.SIG_IGN)

        def watch_parent() -> None:
            # The raw descriptor: a daemon thread inside of a buffered read breaks the interpreter's shutdown.
            while os.read(0, 1):
                pass
            stop.set()
            # The parent is gone, and with it the router: nobody is left to finish work for.
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
    """End the process when a thread has taken no processor time for long: it hangs, however alive the others are.

    Threads that wait for work ask for it now and then, which takes time enough.
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
