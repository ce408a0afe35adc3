import dataclasses

import pytest

from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import PROVENANCE, provenance_with_robot, write_shard


def test_mixed_image_sizes_are_refused_with_both(two_shards) -> None:
    write_shard(two_shards, [9], number=9, height_px=16, width_px=20)
    with pytest.raises(DatasetError, match=r"24x32 in .*00000.mcap, 16x20 in .*00009.mcap"):
        Dataset([two_shards])


def test_mixed_robots_are_refused_with_both(two_shards) -> None:
    write_shard(two_shards, [9], number=9, provenance=provenance_with_robot(v_max_mps=0.7))
    with pytest.raises(DatasetError, match=r"Robots differ: v_max_mps 1\.0 and 0\.7 in .*00000.mcap and .*00009.mcap"):
        Dataset([two_shards])


def test_mixed_sensors_are_refused_with_both(two_shards) -> None:
    config = {**PROVENANCE.config, "renderer": {"sensor": {"exposure_ev": [-0.3, 0.3]}}}
    write_shard(two_shards, [9], number=9, provenance=dataclasses.replace(PROVENANCE, config=config))
    with pytest.raises(DatasetError, match=r"Sensors differ: exposure_ev \[\] and \[-0\.3, 0\.3\] in .*00000.mcap and"):
        Dataset([two_shards])


def test_mixed_kinds_of_depth_are_refused_where_depths_are_recorded(two_shards) -> None:
    mean = dataclasses.replace(PROVENANCE, config={**PROVENANCE.config, "renderer": {"depth": "mean"}})
    assert (PROVENANCE.depth, mean.depth) == ("median", "mean")
    write_shard(two_shards, [7], number=7, outputs=("depth",), provenance=PROVENANCE)
    write_shard(two_shards, [8], number=8, provenance=mean)
    assert len(Dataset([two_shards]).shards) == 4
    write_shard(two_shards, [9], number=9, outputs=("depth",), provenance=mean)
    with pytest.raises(DatasetError, match=r"Depths differ: median in .*00007.mcap, mean in .*00009.mcap"):
        Dataset([two_shards])
