import dataclasses

from readygo.apps.monitor import watch as watching
from readygo.apps.monitor.watch import RunWatch
from readygo.common.bus import InProcessBus, Member
from readygo.common.fleet.shown import state_of
from readygo.common.messages import DriverKind, EpisodeKey, Outcome, Split, topics
from readygo.common.messages.live import LiveCommit, LiveEvaluation, LiveLoss, LivePreview, LiveState, LiveWork
from tests.apps.monitor.watched import Worker, status, tell_status, watched
from tests.clock import Clock
from tests.common.dataset.episodes import make_episode
from tests.common.perception.test_live import perception
from tests.waiting import wait_for


def states(index: int = 0, count: int = 4) -> list[LiveState]:
    header, samples = make_episode(index, count)
    return [state_of(header, sample) for sample in samples]


def commit(index: int, outcome: Outcome = Outcome.SUCCESS, driver: DriverKind = DriverKind.POLICY) -> LiveCommit:
    key = EpisodeKey(seed=0, split=Split.TRAIN, index=index)
    return LiveCommit(
        episode=key,
        attempt=1,
        outcome=outcome,
        driver=driver,
        policy="ab" * 32,
        sample_count=4,
        shard="shard-rec0-00000",
    )


def renderer(run: InProcessBus, watch: RunWatch, name: str = "render0") -> Worker:
    worker = Worker(run, "renderer", name)
    wait_for(lambda: ("renderer", name) in watch._heard)
    wait_for(lambda: worker.bus.heard(topics.EVALUATION.of("renderer", name)))
    return worker


def test_nothing_is_told_where_nobody_watches() -> None:
    worker = Worker(InProcessBus(), "renderer", "r")
    made: list[int] = []
    worker.bus.tell(topics.STATE, lambda: made.append(1))
    assert not made


def test_episode_under_way_is_known_by_its_worker() -> None:
    run, watch = watched()
    worker = renderer(run, watch)
    for state in states():
        worker.tell(topics.STATE, state)
    key = states()[0].episode
    worker.tell(topics.PREVIEW, LivePreview(episode=key, time_ns=0, format="jpeg", image=b"jpeg"))
    wait_for(lambda: watch.workers["renderer", "render0"].preview)
    (moving,) = watch.under_way()
    assert (moving.worker, len(moving.states)) == ("render0", 4)
    track = moving.track()
    assert track is not None
    assert (track.outcome, track.images_at(0.0)) == (None, {"rgb": b"jpeg"})
    worker.tell(topics.COMMIT, dataclasses.replace(commit(0), episode=key))
    wait_for(lambda: moving.commit)
    assert watch.under_way() == []
    assert watch.moving[key].track().outcome is Outcome.SUCCESS  # type: ignore[union-attr]
    worker.tell(topics.STATE, states()[0])
    wait_for(lambda: moving.commit is None)
    assert len(moving.states) == 1, "another attempt begins anew"


def test_images_of_all_cameras_are_kept_in_bounded_number() -> None:
    run, watch = watched()
    worker = renderer(run, watch)
    seen, key = watch.workers["renderer", "render0"], states()[0].episode
    outputs = {"left.rgb": b"left", "left.depth": b"depth", "mask": b"not shown"}
    for number in range(watching.PREVIEWS_MAX):
        preview = LivePreview(episode=key, time_ns=number, format="jpeg", image=b"jpeg", outputs=outputs)
        worker.tell(topics.PREVIEW, preview)
        # One after the other: of many at once the oldest make room.
        wait_for(lambda number=number: seen.preview and seen.preview.time_ns == number)
    kept = watch.moving[key].previews
    assert kept[-1] == (watching.PREVIEWS_MAX - 1, {"rgb": b"jpeg", "left.rgb": b"left", "left.depth": b"depth"})
    assert len(kept) == watching.PREVIEWS_MAX // 3


def test_newest_perception_is_kept_until_the_episode_begins_again() -> None:
    run, watch = watched()
    worker = renderer(run, watch)
    first, second, *_ = states()
    told = dataclasses.replace(perception(), episode=first.episode)
    worker.tell(topics.STATE, second)
    worker.tell(topics.PERCEPTION, told)
    wait_for(lambda: watch.under_way() and watch.under_way()[0].perception)
    assert watch.under_way()[0].perception.tracks == told.tracks
    worker.tell(topics.STATE, first)
    wait_for(lambda: watch.under_way()[0].perception is None)


def test_old_episodes_give_way() -> None:
    run, watch = watched()
    worker = renderer(run, watch)
    for index in range(watching.EPISODES_MAX + 3):
        worker.tell(topics.STATE, states(index, 1)[0])
        wait_for(lambda index=index: any(key.index == index for key in watch.moving))
    assert len(watch.moving) == watching.EPISODES_MAX
    assert min(key.index for key in watch.moving) == 3


def test_workers_come_work_fail_and_go() -> None:
    run, watch = watched()
    worker = renderer(run, watch)
    key = states()[0].episode
    work = LiveWork(stage="render", episode=key, attempt=1, begins=True, cpu_s=2.0, memory_bytes=10**8)
    worker.tell(topics.WORK, work)
    seen = watch.workers["renderer", "render0"]
    wait_for(lambda: seen.stage == "render")
    worker.tell(topics.WORK, dataclasses.replace(work, begins=False, failed="no memory"))
    wait_for(lambda: seen.done == 1)
    assert (seen.stage, seen.trouble, seen.alive) == ("", "no memory", True)
    worker.bus.close()
    wait_for(lambda: not seen.alive)


def test_numbers_over_time_and_a_run_that_begins_anew() -> None:
    run, watch = watched()
    tell_status(run, status())
    wait_for(lambda: len(watch.progress) == 1)
    watch.begun_s -= 100.0
    tell_status(run, status(samples=900))
    wait_for(lambda: len(watch.progress) == 2)
    assert 0 < watch.samples_hz < 10
    tell_status(run, status(samples=0))
    wait_for(lambda: len(watch.progress) == 1)


def test_success_losses_and_evaluations_are_kept() -> None:
    run, watch = watched()
    worker = renderer(run, watch)
    worker.tell(topics.COMMIT, commit(0))
    worker.tell(topics.COMMIT, commit(1, Outcome.TIMEOUT))
    worker.tell(topics.COMMIT, commit(2, Outcome.TIMEOUT, DriverKind.EXPERT))
    worker.tell(topics.LOSS, LiveLoss(steps=1, samples=50, train_loss=2.0, validation_loss=3.0))
    evaluation = LiveEvaluation(
        episode=commit(0).episode,
        task="static",
        method="policy",
        policy="ab" * 32,
        outcome=Outcome.SUCCESS,
        duration_s=4.0,
    )
    worker.tell(topics.EVALUATION, evaluation)
    wait_for(lambda: len(watch.evaluations) == 1 and len(watch.commits) == 3)
    assert watch.driven.curve(0)[1].tolist() == [1.0, 0.5], "the expert's own do not count"
    assert watch.losses.curve(1)[1].tolist() == [3.0]


def test_who_left_hears_of_nobody_new() -> None:
    run, watch = watched()
    watch.leave()
    Worker(run, "renderer", "late")
    wait_for(lambda: ("renderer", "late") in watch.workers)
    assert not watch._heard


def note_renderer(watch: RunWatch, bus: InProcessBus, name: str, alive: bool = True) -> None:
    """A renderer comes or goes on a bus."""
    watch._on_presence(bus, Member("renderer", name, "s"), alive)


def heard(*names: str) -> tuple[RunWatch, Clock]:
    """A watch whose messages come by hand, and its workers."""
    clock = Clock(1000.0)
    watch, bus = RunWatch(clock), InProcessBus()
    for name in names:
        note_renderer(watch, bus, name)
    return watch, clock


def test_episodes_are_under_way_for_4_seconds_after_their_last_state_one_for_each_worker() -> None:
    watch, clock = heard()
    for worker, index in (("b", 1), ("a", 2), ("a", 3)):
        watch._on_state(("renderer", worker), states(index)[0])
        clock.now_s += 1.0
    assert [(moving.worker, moving.episode.index) for moving in watch.under_way()] == [("a", 3), ("b", 1)]
    clock.now_s += 0.9
    assert len(watch.under_way()) == 2
    clock.now_s += 0.1
    assert [moving.episode.index for moving in watch.under_way()] == [3]
    watch._on_state(("renderer", "a"), states(3)[1])
    moving = watch.moving[states(3)[0].episode]
    assert [at_s for at_s, _ in moving.states] == [1002.0, 1004.0]
    watch._on_state(("renderer", "c"), states(3)[1])
    assert ([at_s for at_s, _ in moving.states], moving.worker) == ([1004.0], "c")


def test_work_is_counted_as_it_ends() -> None:
    watch, clock = heard("r")
    key, seen = states()[0].episode, watch.workers["renderer", "r"]
    assert seen.since_s == 1000.0
    clock.now_s = 1003.0
    begun = LiveWork(stage="render", episode=key, attempt=1, begins=True, cpu_s=2.5, memory_bytes=7)
    watch._on_work(("renderer", "r"), begun)
    assert (seen.stage, seen.episode, seen.since_s, seen.done, seen.rejected) == ("render", key, 1003.0, 0, 0)
    assert (seen.cpu_s, seen.memory_bytes) == (2.5, 7)
    for rejected, failed in (("fog", ""), ("", "no memory"), ("", "")):
        watch._on_work(("renderer", "r"), dataclasses.replace(begun, begins=False, rejected=rejected, failed=failed))
    assert (seen.stage, seen.episode, seen.done, seen.rejected, seen.trouble) == ("", None, 3, 1, "no memory")
    watch._on_work(("renderer", "stranger"), begun)
    assert list(watch.workers) == [("renderer", "r")]
    note_renderer(watch, InProcessBus(), "r", alive=False)
    assert not seen.alive


def test_numbers_are_taken_over_time_since_it_began() -> None:
    watch, clock = heard()
    clock.now_s += 90.0
    counts = {"waiting": {"a": 3, "b": 4}, "leased": {"a": 2, "b": 6}, "rejected": {"x": 1, "y": 8}}
    watch._on_progress(status(samples=50, committed=5, requeued=9, **counts))
    assert watch.heard_s == 1090.0
    assert [[float(v[0]) for v in watch.progress.curve(column)] for column in range(6)] == [
        [90.0, 50.0], [90.0, 5.0], [90.0, 7.0], [90.0, 8.0], [90.0, 9.0], [90.0, 9.0]
    ]  # fmt: skip
    clock.now_s += 30.0
    watch._on_progress(status(samples=50, committed=6, **counts))
    assert len(watch.progress) == 2
    watch._on_progress(status(samples=49, committed=6, **counts))
    assert len(watch.progress) == 1
    for k, outcome in enumerate([Outcome.SUCCESS, Outcome.TIMEOUT, Outcome.TIMEOUT]):
        clock.now_s = 1000.0 + 60.0 * (k + 1)
        watch._on_commit(("recorder", "r"), commit(k, outcome))
        watch._on_commit(("recorder", "r"), commit(k, Outcome.SUCCESS, DriverKind.EXPERT))
    x, y = watch.driven.curve(0)
    assert (x.tolist(), y.tolist()) == ([1.0, 2.0, 3.0], [1.0, 0.5, 1 / 3])
    assert len(watch.commits) == 6


def test_at_most_256_workers_are_kept_and_those_that_left_give_way_first() -> None:
    watch, _ = heard(*(f"w{number}" for number in range(256)))
    bus = InProcessBus()
    note_renderer(watch, bus, "w7", alive=False)
    note_renderer(watch, bus, "late")
    assert len(watch.workers) == 256
    assert ("renderer", "w7") not in watch.workers
    note_renderer(watch, bus, "later")
    assert ("renderer", "w0") not in watch.workers
    assert len(watch.workers) == 256


def test_worker_is_heard_once_on_every_bus() -> None:
    watch = RunWatch()
    bus, heard_streams = InProcessBus(), []
    bus.subscribe = lambda stream, handler: heard_streams.append(stream.name)  # type: ignore[method-assign]
    watch.join(bus)
    note_renderer(watch, bus, "r", alive=False)
    assert heard_streams == ["live/progress"]
    for _ in range(2):
        note_renderer(watch, bus, "r")
    kinds = ("work", "state", "preview", "perception", "plan", "commit", "loss", "evaluation")
    assert heard_streams == ["live/progress", *(f"live/renderer/r/{kind}" for kind in kinds)]
    note_renderer(watch, InProcessBus(), "other")
    assert len(heard_streams) == 9, "it is not this bus's"
    watch.workers["renderer", "r"].alive = True
    watch.join(bus)
    assert not watch.workers["renderer", "r"].alive


def test_worker_that_meets_its_successor_is_there_until_both_have_left() -> None:
    watch, bus = RunWatch(Clock(1000.0)), InProcessBus()
    for session, alive, seen in (("a", True, True), ("b", True, True), ("a", False, True), ("b", False, False)):
        watch._on_presence(bus, Member("renderer", "r0", session), alive)
        assert watch.workers["renderer", "r0"].alive == seen
