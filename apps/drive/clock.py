"""The robot's clock beside ours: how old is what it says?"""

from dataclasses import dataclass, field

JUMP_NS = 500_000_000
"""A stamp that is this far from where it should be has been set, not delayed [ns]."""


@dataclass
class RobotClock:
    """What is known of a robot's clock: nothing but the stamps of its messages, and when they came.

    The message that came fastest says how the two clocks stand to each other; how much later than that another one came
    is its age. So clocks that differ do no harm, as long as both run.
    """

    _offset_ns: int | None = None
    _newest_ns: dict[str, int] = field(default_factory=dict)

    def hear(self, topic: str, stamp_ns: int, arrived_ns: int) -> str:
        """Note when a message was made and came.

        Args:
            topic: Whose stamps only rise.
            stamp_ns: By the robot's clock [ns].
            arrived_ns: By ours [ns].

        Returns:
            Empty, or how the robot's clock has jumped.
        """
        newest_ns, late_ns = self._newest_ns.get(topic, stamp_ns), arrived_ns - stamp_ns
        offset_ns = late_ns if self._offset_ns is None else self._offset_ns
        self._newest_ns[topic] = stamp_ns
        self._offset_ns = min(offset_ns, late_ns)
        if stamp_ns < newest_ns - JUMP_NS:
            return f"the robot's clock went back by {(newest_ns - stamp_ns) / 1e9:.1f} s ({topic})"
        if late_ns < offset_ns - JUMP_NS:
            return f"the robot's clock jumped ahead by {(offset_ns - late_ns) / 1e9:.1f} s ({topic})"
        return ""

    def age_s(self, stamp_ns: int, now_ns: int) -> float:
        """How long ago a message was made [s]."""
        return (now_ns - stamp_ns - (self._offset_ns or 0)) / 1e9
