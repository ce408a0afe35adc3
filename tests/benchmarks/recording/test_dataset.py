import cv2
import numpy as np

from readygo.benchmarks.recording.dataset import SAMPLES, make_image, make_requests, record
from readygo.common.dataset import Dataset


def test_images_are_like_rendered_ones_and_differ() -> None:
    one, other = make_image(0), make_image(1)
    assert cv2.imdecode(np.frombuffer(one, np.uint8), cv2.IMREAD_COLOR).shape == (144, 256, 3)
    assert 10_000 < len(one) < 20_000
    assert one != other


def test_batches_are_a_whole_episode() -> None:
    requests = make_requests(4, [b"a", b"b"])
    samples = [sample for request in requests for sample in request.samples]
    assert [sample.seq for sample in samples] == list(range(SAMPLES))
    assert all(sample.intact for sample in samples)
    assert [request.last for request in requests] == [False] * (len(requests) - 1) + [True]
    assert {request.header.episode.index for request in requests} == {4}


def test_episode_is_recorded_under_as_many_indices_as_asked_for(tmp_path) -> None:
    image = make_image(0)
    record(tmp_path, make_requests(0, [image]), 2, fsync=False)
    dataset = Dataset([tmp_path])
    assert [(entry.episode.index, entry.sample_count) for entry in dataset.episodes] == [(0, SAMPLES), (1, SAMPLES)]
    assert dataset.image(SAMPLES + 3) == image
