from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.messages import EpisodeKey, Split
from readygo.services.renderer.sensor.streams import SensorStream


def test_streams_belong_to_their_episode_and_frame_alone() -> None:
    keys = [EpisodeKey(seed=seed, split=split, index=4) for seed in (1, 2) for split in (Split.TRAIN, Split.TEST)]
    streams = [SensorStream.of_episode(key) for key in keys] + [SensorStream.of_people(name) for name in ("", "a")]
    words = [rng.bytes(16) for stream in streams for rng in (stream.of_draws(), stream.of_frame(0), stream.of_frame(1))]
    assert len(set(words)) == len(words)
    assert SensorStream.of_episode(keys[0]).of_frame(7).bytes(8) == streams[0].of_frame(7).bytes(8)
    assert streams[0].of_draws().random() == episode_rng(keys[0], Purpose.SENSOR).random()
