"""Ages of a robot's messages, without a shared clock."""

from dataclasses import dataclass, field

JUMP_NS = 500_000_000
"""A stamp with a larger error means that the clock was set, not that the message was delayed [ns]."""


@dataclass
class RobotClock:
    """Offset of a robot's clock, estimated from the stamps of its messages and their times of arrival.

    The fastest message determines the offset of the two clocks; the additional delay of any other message is its age.
    So a constant offset does no harm, as long as both clocks run.
    """

    _offset_ns: int | None = None
    _newest_ns: dict[str, int] = field(default_factory=dict)

    def hear(self, topic: str, stamp_ns: int, arrived_ns: int) -> str:
        """Record the stamp and the arrival of a message.

        Args:
            topic: Topic of the message; the stamps of one topic only rise.
            stamp_ns: Stamp, by the robot's clock [ns].
            arrived_ns: Arrival, by this machine's clock [ns].

        Returns:
            Empty, or a description of a jump of the robot's clock.
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
        """Age of a message with this stamp [s]."""
        return (now_ns - stamp_ns - (self._offset_ns or 0)) / 1e9
