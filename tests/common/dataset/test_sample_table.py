import numpy as np

from readygo.common.dataset.index import load_index
from readygo.common.dataset.sample_table import SampleTable
from tests.common.dataset.episodes import write_shard


def test_samples_come_in_the_order_of_the_episodes_with_what_all_shards_have(tmp_path) -> None:
    rich = load_index(write_shard(tmp_path, [4, 0], number=0, outputs=("depth", "mask"), sample_count=2))
    plain = load_index(write_shard(tmp_path, [2], number=1, outputs=("mask",), sample_count=3))
    table = SampleTable.of([rich, plain], [(0, 1), (1, 0), (0, 0)])
    assert table.shard.tolist() == [0, 0, 1, 1, 1, 0, 0]
    assert table.episode.tolist() == [0, 0, 1, 1, 1, 2, 2]
    assert table.first.tolist() == [0, 0, 2, 2, 2, 5, 5]
    np.testing.assert_array_equal(table.rows, np.concatenate([rich.samples[2:], plain.samples, rich.samples[:2]]))
    assert list(table.payloads) == ["mask"]
    masks = rich.outputs["mask"], plain.outputs["mask"]
    np.testing.assert_array_equal(table.payloads["mask"], np.concatenate([masks[0][2:], masks[1], masks[0][:2]]))
