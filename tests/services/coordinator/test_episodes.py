import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.common.messages.stages import EXPERT_LINE, RENDER
from readygo.services.coordinator.database import Database
from readygo.services.coordinator.episodes import Episodes
from readygo.services.coordinator.protocol import EpisodeRow, Holder, StageState

WHOLE = EpisodeRow(
    index=3,
    stage=RENDER.name,
    state=StageState.LEASED,
    attempt=4,
    failures=1,
    deaths=2,
    holder=Holder(worker="desk-1", role="renderer", session="first"),
    recorder="rec0",
    shard="shard-rec0-00001.mcap",
    samples=17,
    driven_by="policy",
    reason="slow",
)


@pytest.fixture
def episodes(tmp_path: Path) -> Iterator[Episodes]:
    database = Database(tmp_path / "ledger.sqlite")
    episodes = Episodes(database)
    episodes.open(range(5), EXPERT_LINE[0].name)
    yield episodes
    database.close()


def test_every_field_comes_back_and_no_other_row_changes(episodes: Episodes) -> None:
    others = [episodes.get(index) for index in (2, 4)]
    episodes.store(WHOLE)
    assert episodes.get(3) == WHOLE
    assert [episodes.get(index) for index in (2, 4)] == others
    assert others[0] == EpisodeRow(index=2, stage=EXPERT_LINE[0].name)
    assert episodes.get(5) is None


def test_open_episodes_stay_as_they_are(episodes: Episodes) -> None:
    episodes.store(WHOLE)
    episodes.open([3, 5], "animate")
    assert episodes.get(3) == WHOLE
    assert episodes.get(5) == EpisodeRow(index=5, stage="animate")


def test_smallest_waiting_index_of_a_stage_comes_first(episodes: Episodes) -> None:
    first = EXPERT_LINE[0].name
    episodes.store(dataclasses.replace(WHOLE, index=0))
    found = episodes.first_waiting(first)
    assert found is not None
    assert found.index == 1
    assert episodes.first_waiting(RENDER.name) is None


def test_episodes_are_found_by_holder_recorder_shard_and_deadline(episodes: Episodes) -> None:
    episodes.store(WHOLE)
    episodes.store(dataclasses.replace(WHOLE, index=4, state=StageState.COMMITTED))
    episodes.begin_lease(3, 10.0, with_policy=False)
    assert episodes.held_by(WHOLE.holder) == [WHOLE]
    for other in ({"worker": "desk-2"}, {"role": "animator"}, {"session": "second"}):
        assert episodes.held_by(dataclasses.replace(WHOLE.holder, **other)) == []
    assert {episode.index for episode in episodes.of_recorder("rec0")} == {3, 4}
    assert episodes.of_recorder("rec1") == []
    assert [episode.index for episode in episodes.in_shard(WHOLE.shard)] == [4]
    assert episodes.leased_episodes() == episodes.leased_episodes(before_s=10.5) == [WHOLE]
    assert episodes.leased_episodes(before_s=10.0) == []
    assert episodes.renew(3, 4, 20.0)
    assert not episodes.renew(3, 5, 30.0)
    assert not episodes.renew(4, 4, 30.0), "committed"
    assert episodes.leased_episodes(before_s=19.0) == []
