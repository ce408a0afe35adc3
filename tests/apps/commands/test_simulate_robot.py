import pytest

from readygo.apps.commands.simulate_robot import simulate_robot
from readygo.common.errors import ConfigError


@pytest.mark.parametrize(
    ("options", "words"),
    [({"camera_hz": 30.0}, "20 Hz divided by a whole number, got 30"), ({"drop_share": 1.5}, "share of lost images")],
)
def test_manners_that_no_robot_has_are_refused_before_anything_is_loaded(options, words):
    with pytest.raises(ConfigError, match=words):
        simulate_robot("no such scene", **options)
