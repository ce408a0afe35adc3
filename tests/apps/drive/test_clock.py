import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from readygo.apps.drive.clock import RobotClock

S = 1_000_000_000
JUMP_NS = S // 2
AHEAD_NS = 7_777 * S + 13
"""The robot's clock when ours is at 0."""
MESSAGES = st.lists(
    st.tuples(
        st.sampled_from(["/odom", "/image"]),
        st.integers(0, 2 * S),  # since the message before, by our clock
        st.one_of(st.just(0), st.integers(0, S)),  # on its way
        st.sampled_from([0, 0, 0, JUMP_NS, JUMP_NS + 1, -JUMP_NS, -JUMP_NS - 1, 3 * S, -9 * S]),  # set meanwhile
    ),
    min_size=1,
    max_size=12,
)


@settings(deadline=None)
@given(MESSAGES)
def test_offset_is_the_least_delay_so_far_and_jumps_are_what_no_delay_explains(messages) -> None:
    clock, now_ns, ahead_ns = RobotClock(), 0, AHEAD_NS
    heard: list[tuple[str, int, int]] = []
    for topic, pause_ns, way_ns, set_ns in messages:
        now_ns, ahead_ns = now_ns + pause_ns, ahead_ns + set_ns
        stamp_ns = now_ns + ahead_ns - way_ns
        before_ns = [stamp for other, stamp, _ in heard if other == topic][-1:]
        least_ns = min((late for _, _, late in heard), default=None)
        expected = ""
        if least_ns is not None and now_ns - stamp_ns < least_ns - JUMP_NS:
            expected = f"the robot's clock jumped ahead by {(least_ns - now_ns + stamp_ns) / S:.1f} s ({topic})"
        if before_ns and stamp_ns < before_ns[0] - JUMP_NS:
            expected = f"the robot's clock went back by {(before_ns[0] - stamp_ns) / S:.1f} s ({topic})"
        assert clock.hear(topic, stamp_ns, now_ns) == expected
        heard.append((topic, stamp_ns, now_ns - stamp_ns))
        least_ns = min(late for _, _, late in heard)
        assert clock.age_s(stamp_ns, now_ns + 5) == (now_ns + 5 - stamp_ns - least_ns) / S


def test_clocks_that_differ_do_not_matter_for_ages():
    clock = RobotClock()
    assert clock.age_s(3 * S, 5 * S) == 2.0
    # The first message is slow: the next one tells how the clocks stand.
    assert clock.hear("/image", AHEAD_NS - S // 4, 0) == ""
    assert clock.age_s(AHEAD_NS - S // 4, 0) == 0.0
    for k in range(10):
        assert clock.hear("/odom", AHEAD_NS + k * S // 10, k * S // 10) == ""
    assert clock.age_s(AHEAD_NS - S // 4, S // 2) == 0.75
    assert clock.hear("/odom", AHEAD_NS + S, 3 * S) == "", "it was delayed"
    assert clock.age_s(AHEAD_NS + S, 3 * S) == 2.0


@pytest.mark.parametrize("beyond_ns", [0, 1])
def test_clocks_that_are_set_by_more_than_half_a_second_are_noticed_either_way(beyond_ns):
    clock = RobotClock()
    clock.hear("/odom", AHEAD_NS, 0)
    back = "the robot's clock went back by 0.5 s (/odom)" if beyond_ns else ""
    assert clock.hear("/odom", AHEAD_NS - JUMP_NS - beyond_ns, S // 20) == back
    clock = RobotClock()
    clock.hear("/odom", AHEAD_NS, 0)
    clock.hear("/odom", AHEAD_NS, 9 * S)
    ahead = "the robot's clock jumped ahead by 0.5 s (/image)" if beyond_ns else ""
    assert clock.hear("/image", AHEAD_NS + S + JUMP_NS + beyond_ns, S) == ahead
