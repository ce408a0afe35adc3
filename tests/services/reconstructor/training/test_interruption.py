import signal
import threading

from readygo.services.reconstructor.training.interruption import interruption


def test_ctrl_c_is_noted_and_raises_nothing_until_the_end() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruption() as interrupted:
        assert not interrupted()
        signal.raise_signal(signal.SIGINT)
        assert interrupted()
    assert signal.getsignal(signal.SIGINT) is before


def test_other_threads_hear_nothing() -> None:
    heard: list[bool] = []

    def listen() -> None:
        with interruption() as interrupted:
            heard.append(interrupted())

    thread = threading.Thread(target=listen)
    thread.start()
    thread.join()
    assert heard == [False]
