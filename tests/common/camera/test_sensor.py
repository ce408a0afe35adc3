import dataclasses
import tomllib

import numpy as np
import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError

CAMERA = CameraConfig(distortion="brown_conrady", k2=0.5)
SENSOR = SensorConfig(k1=(-0.04, 0.01), red_gain=(0.9, 1.1), exposure_s=(0.005, 0.01))


def test_sensor_varies_nothing_by_default() -> None:
    assert not SensorConfig().varies
    assert SensorConfig(readout_s=(0.0, 0.01)).varies
    assert SensorConfig().draw_camera(CAMERA, np.random.default_rng(0)) == CAMERA


def test_sensor_travels_as_a_plain_mapping_and_as_toml() -> None:
    assert section_from_mapping(SensorConfig, section_to_mapping(SENSOR)) == SENSOR
    read = section_from_mapping(SensorConfig, tomllib.loads("exposure_s = [0.005, 0.01]"))
    assert read == SensorConfig(exposure_s=(0.005, 0.01))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"exposure_ev": [0.3, -0.3]}, r"exposure_ev must be \[lowest, highest\]"),
        ({"exposure_ev": [0.3]}, r"exposure_ev must be \[lowest, highest\]"),
        ({"readout_s": [0.0, 0.2]}, r"readout_s must be 0\.\.0\.05 s, got 0\.2"),
        ({"k1": [0.0, float("inf")]}, "k1 must be"),
        ({"k1": 0.1}, "k1 must be an array"),
        ({"mount_x_m": [0.0, 0.1]}, "Unknown key"),
    ],
)
def test_wrong_ranges_are_refused_in_one_line(wrong, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        section_from_mapping(SensorConfig, wrong)
    assert "\n" not in str(caught.value)


def test_every_range_is_of_a_value_that_the_camera_has() -> None:
    assert {name for name, _ in SensorConfig().items()} <= {entry.name for entry in dataclasses.fields(CameraConfig)}


def test_drawn_values_lie_in_their_ranges_and_differ_between_episodes() -> None:
    drawn = [SENSOR.draw_camera(CAMERA, np.random.default_rng(seed)) for seed in range(20)]
    for name, ends in SENSOR.items():
        values = [getattr(one, name) for one in drawn]
        assert len(set(values)) == (20 if ends else 1)
        assert not ends or all(ends[0] <= value <= ends[1] for value in values)
    assert {one.k2 for one in drawn} == {0.5}


def test_another_range_leaves_the_other_draws_alone() -> None:
    one = SensorConfig(exposure_ev=(-1, 1), readout_s=(0.0, 0.02))
    more = dataclasses.replace(one, red_gain=(0.5, 2.0))
    first, second = (sensor.draw_camera(CAMERA, np.random.default_rng(5)) for sensor in (one, more))
    assert (first.exposure_ev, first.readout_s) == (second.exposure_ev, second.readout_s)


def test_extremes_are_all_combinations_of_the_lens_ranges_ends() -> None:
    sensor = SensorConfig(k1=(-1, 1), p1=(2, 3), exposure_ev=(0, 1))
    found = {(one.k1, one.k2, one.p1) for one in sensor.extremes(CAMERA)}
    assert found == {(k1, 0.5, p1) for k1 in (-1, 1) for p1 in (2, 3)}
