"""A clock that tests set."""


class Clock:
    """Stands in for `time.monotonic`."""

    def __init__(self, now_s: float = 0.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        """The time that the test has set [s]."""
        return self.now_s
