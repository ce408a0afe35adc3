import numpy as np

from readygo.common.dataset import Dataset
from tests.common.dataset.episodes import make_episode, write_shard


def test_humans_are_known_without_labels_in_the_order_of_the_samples(tmp_path) -> None:
    write_shard(tmp_path, [4, 1], number=0)
    write_shard(tmp_path, [2], number=1)
    dataset = Dataset([tmp_path])
    wanted = [sample.humans_xyzyaw for index in (1, 2, 4) for sample in make_episode(index)[1]]
    assert len(dataset.humans_xyzyaw) == len(dataset) == len(wanted)
    for got, want in zip(dataset.humans_xyzyaw, wanted, strict=True):
        np.testing.assert_allclose(got, np.reshape(want, (-1, 4)), atol=1e-12)
    assert any(len(poses) for poses in dataset.humans_xyzyaw)
    for number, entry in enumerate(dataset.episodes):
        rows = slice(entry.first_sample, entry.first_sample + entry.sample_count)
        for alone, among_all in zip(dataset.humans_of(number), dataset.humans_xyzyaw[rows], strict=True):
            np.testing.assert_array_equal(alone, among_all)
