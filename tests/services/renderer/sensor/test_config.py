import dataclasses
import tomllib

import numpy as np
import pytest

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.errors import ConfigError
from readygo.common.messages import EpisodeKey, Split
from readygo.services.renderer import RendererConfig
from readygo.services.renderer.sensor.config import SENSOR_RECIPES, SensorConfig, SensorRanges, sensor_phone_like
from readygo.services.renderer.sensor.streams import SensorStream


def test_default_sensor_is_off_and_every_other_is_not() -> None:
    assert SensorConfig().off
    assert SensorConfig(sub_frames=3).off
    assert not SensorConfig(exposure_ev=0.1).off
    assert not SensorConfig(ranges=SensorRanges(readout_s=(0.0, 0.01))).off
    assert SENSOR_RECIPES["off"]().off


def test_sensor_travels_as_a_plain_mapping_and_as_toml() -> None:
    config = RendererConfig(contact_shadow=True, sensor=sensor_phone_like())
    assert section_from_mapping(RendererConfig, section_to_mapping(config)) == config
    text = '[sensor]\ndistortion = "fisheye"\nk1 = 0.01\n[sensor.ranges]\nexposure_s = [0.005, 0.01]\n'
    read = section_from_mapping(RendererConfig, tomllib.loads(text)).sensor
    assert (read.distortion, read.k1, read.ranges.exposure_s) == ("fisheye", 0.01, (0.005, 0.01))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"exposure_s": -0.01}, r"sensor: exposure_s must be 0\.\.0\.05 s, got -0\.01"),
        ({"ranges": {"exposure_ev": [0.3, -0.3]}}, r"ranges\.exposure_ev must be \[lowest, highest\]"),
        ({"ranges": {"readout_s": [0.0, 0.2]}}, r"readout_s must be 0\.\.0\.05 s, got 0\.2"),
        ({"k1": 0.1}, 'k1 has no meaning with distortion "none"'),
        ({"distortion": "brown_conrady", "k4": 0.1}, "k4 has no meaning"),
        ({"vignetting": 1.5}, "vignetting must be 0..1"),
        ({"red_gain": 0.0}, "red_gain must be"),
        ({"sub_frames": 1}, "sub_frames must be"),
        ({"distortion": "barrel"}, "must be one of"),
        ({"k1": float("nan")}, "k1 must be a finite number"),
    ],
)
def test_wrong_values_are_refused_in_one_line(wrong, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        section_from_mapping(RendererConfig, {"sensor": wrong})
    assert "\n" not in str(caught.value)


def test_drawn_values_lie_in_their_ranges_and_differ_between_episodes() -> None:
    sensor = sensor_phone_like()
    drawn = [sensor.drawn(np.random.default_rng(seed)) for seed in range(20)]
    for name, ends in sensor.ranges.items():
        values = [getattr(one, name) for one in drawn]
        assert len(set(values)) == (20 if ends else 1)
        assert not ends or all(ends[0] <= value <= ends[1] for value in values)
    assert all(one.ranges == SensorRanges() for one in drawn)


def test_another_range_leaves_the_other_draws_alone() -> None:
    one = SensorConfig(ranges=SensorRanges(exposure_ev=(-1, 1), readout_s=(0.0, 0.02)))
    more = dataclasses.replace(one, ranges=dataclasses.replace(one.ranges, red_gain=(0.5, 2.0)))
    first, second = (sensor.drawn(np.random.default_rng(5)) for sensor in (one, more))
    assert (first.exposure_ev, first.readout_s) == (second.exposure_ev, second.readout_s)


def test_extremes_are_all_combinations_of_the_lens_ranges_ends() -> None:
    sensor = SensorConfig(
        distortion="brown_conrady", k2=0.5, ranges=SensorRanges(k1=(-1, 1), p1=(2, 3), exposure_ev=(0, 1))
    )
    assert {(one.k1, one.k2, one.p1) for one in sensor.extremes()} == {(k1, 0.5, p1) for k1 in (-1, 1) for p1 in (2, 3)}


def test_streams_belong_to_their_episode_and_frame_alone() -> None:
    keys = [EpisodeKey(seed=seed, split=split, index=4) for seed in (1, 2) for split in (Split.TRAIN, Split.TEST)]
    streams = [SensorStream.of_episode(key) for key in keys] + [SensorStream.of_people(name) for name in ("", "a")]
    words = [rng.bytes(16) for stream in streams for rng in (stream.of_draws(), stream.of_frame(0), stream.of_frame(1))]
    assert len(set(words)) == len(words)
    assert SensorStream.of_episode(keys[0]).of_frame(7).bytes(8) == streams[0].of_frame(7).bytes(8)
    assert streams[0].of_draws().random() == episode_rng(keys[0], Purpose.SENSOR).random()
