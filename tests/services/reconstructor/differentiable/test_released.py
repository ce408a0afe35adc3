import threading
import time

from readygo.services.reconstructor.differentiable.released import kernel_without_gil


@kernel_without_gil
def spin(count: int) -> float:
    """Takes some tenths of a second: each number needs the one before."""
    value = 1.0
    for k in range(count):
        value = value * 0.999999 + 1.0 / (k + 1.0)
    return value


def test_other_threads_run_while_a_kernel_does() -> None:
    spin(10)
    begun = threading.Event()

    def work() -> None:
        begun.set()
        spin(50_000_000)

    worker = threading.Thread(target=work)
    worker.start()
    begun.wait()
    turns = 0
    while worker.is_alive():
        time.sleep(0.001)
        turns += 1
    assert turns > 5
