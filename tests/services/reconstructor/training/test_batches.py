from readygo.services.reconstructor.training.batches import batch_views


def test_every_view_comes_once_an_epoch() -> None:
    train_views = (1, 2, 3, 5, 7)
    drawn = [number for step in range(5) for number in batch_views(train_views, step, 2, 0)]
    assert sorted(drawn[:5]) == sorted(drawn[5:]) == list(train_views)
    assert drawn[:5] != drawn[5:]
