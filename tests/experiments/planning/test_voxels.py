import numpy as np

from experiments.planning.voxels import ALIGNED, BOX, MEAN, own_sums, peer_sums, synthetic_ground


def test_row_form_gives_the_sums_of_the_exact_test_of_every_voxel():
    ground = synthetic_ground(3000, seed=1)
    own = own_sums(ground)
    assert own.any()
    np.testing.assert_array_equal(own, peer_sums(ground, BOX))
    larger, smaller = peer_sums(ground, ALIGNED), peer_sums(ground, MEAN)
    assert (own <= larger).all()
    assert (smaller <= own).all()
    assert (own < larger).any()
    assert (smaller < own).any()
