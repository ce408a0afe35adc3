"""Something done again and again beside the work."""

import contextlib
import threading
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def repeating(act: Callable[[], object], *, every_s: float, name: str) -> Iterator[None]:
    """Call a function on a separate thread for as long as the block runs; first after one interval.

    Args:
        act: The function; it raises nothing.
        every_s: Interval [s].
        name: Name of the thread.
    """
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(every_s):
            act()

    thread = threading.Thread(target=repeat, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
