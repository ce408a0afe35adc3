from readygo.common.fleet.at_work import AT_WORK, AtWork, working


def test_what_is_worked_on_is_known_while_it_is() -> None:
    with working(stage="render", episode="train-0-000001", attempt=2):
        assert AT_WORK.get() == AtWork(stage="render", episode="train-0-000001", attempt=2)
    assert AT_WORK.get() is None
