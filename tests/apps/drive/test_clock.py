from readygo.apps.drive.clock import RobotClock

S = 1_000_000_000


def test_clocks_that_differ_do_not_matter_for_ages():
    clock = RobotClock()
    for k in range(10):
        assert clock.hear("/odom", 500 * S + k * S // 10, k * S // 10) == ""
        assert clock.hear("/image", 500 * S + k * S // 10 - S // 20, k * S // 10) == ""
    assert clock.age_s(500 * S + 9 * S // 10, 9 * S // 10) == 0.0
    assert clock.age_s(500 * S + 9 * S // 10 - S // 20, S) == 0.15


def test_a_message_that_was_delayed_is_old_and_no_jump():
    clock = RobotClock()
    clock.hear("/odom", 500 * S, 0)
    assert clock.hear("/odom", 501 * S, 3 * S) == ""
    assert clock.age_s(501 * S, 3 * S) == 2.0


def test_clocks_that_are_set_are_noticed_either_way():
    clock = RobotClock()
    clock.hear("/odom", 500 * S, 0)
    assert clock.hear("/odom", 490 * S, S // 20) == "the robot's clock went back by 10.0 s (/odom)"
    clock = RobotClock()
    clock.hear("/odom", 500 * S, 0)
    assert clock.hear("/odom", 560 * S, S) == "the robot's clock jumped ahead by 59.0 s (/odom)"
