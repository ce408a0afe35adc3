import dataclasses
import json
import shlex
import shutil

import cv2
import pytest

from readygo.apps.commands.plan import PlanEpisodeOptions, PlanOptions, plan
from readygo.apps.evaluation.again import SPEC_FILE, keep_spec, kept_episode, plan_command
from readygo.common.errors import RunError
from readygo.common.messages import Outcome
from readygo.services.evaluator import Task
from tests.apps.evaluation.records import record


@pytest.fixture(scope="module")
def folder(evaluated, tmp_path_factory):
    """The results of the evaluation, finished."""
    copy = tmp_path_factory.mktemp("results") / "finished"
    shutil.copytree(evaluated.folder, copy)
    keep_spec(copy, evaluated.replays.world.spec)
    return copy


def options_of(driven):
    return {"task": driven.task.value, "method": driven.method}


def test_every_episode_is_driven_again_to_the_end_that_it_had(evaluated, folder):
    for driven in evaluated.reply.records:
        with kept_episode(folder, driven.episode.episode_id, **options_of(driven)) as (replays, found):
            assert found == driven
            run = replays.run(found)
        assert run.driver == driven.method
        assert run.trajectory.outcome is driven.result.outcome
        assert run.trajectory.duration_s == pytest.approx(driven.result.duration_s)


def test_plan_tells_and_shows_it(evaluated, folder, tmp_path, capsys):
    driven = evaluated.reply.records[0]
    capsys.readouterr()
    picture = tmp_path / "episode.png"
    plan(
        PlanOptions(
            scene=driven.episode.episode_id,
            from_=folder,
            episode=PlanEpisodeOptions(**options_of(driven)),
            picture=picture,
            json=True,
        )
    )
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["driver"] == driven.method
    assert numbers["outcome"] == driven.result.outcome.value
    assert numbers["duration_s"] == driven.result.duration_s
    assert abs(numbers["path_length_m"] - driven.result.path_length_m) < 1e-3
    assert not {"rejected", "drive_ms"} & set(numbers), "nothing is generated"
    assert cv2.imread(str(picture)) is not None


def test_policy_is_taken_where_no_method_is_named(evaluated, folder):
    name = evaluated.reply.records[0].episode.episode_id
    with kept_episode(folder, name, "static") as (_, found):
        assert (found.method, found.task) == ("policy", Task.STATIC)


def test_what_is_not_there_is_named(evaluated, folder, tmp_path):
    name = evaluated.reply.records[0].episode.episode_id
    for words, message in (
        (("test-0-000099",), r"has no episode 'test-0-000099'; it has test-0-\d+ to test-0-\d+\."),
        ((name,), "has 2 such episodes .*--task dynamic --method policy, --task dynamic --method straight-line"),
        ((name, "static", "nobody"), "has 0 such episodes"),
    ):
        with pytest.raises(RunError, match=message), kept_episode(folder, *words):
            pass
    with pytest.raises(RunError, match="holds no results: No such file"), kept_episode(tmp_path, name):
        pass


def test_spec_that_is_missing_broken_or_another_evaluations_is_refused(evaluated, folder, tmp_path):
    name, copy = evaluated.reply.records[0].episode.episode_id, tmp_path / "copy"
    shutil.copytree(folder, copy)
    keep_spec(copy, dataclasses.replace(evaluated.replays.world.spec, scenarios="# another"))
    with (
        pytest.raises(RunError, match="is of another evaluation: scenarios differ"),
        kept_episode(copy, name, "static"),
    ):
        pass
    (copy / SPEC_FILE).write_bytes(b"no spec")
    with pytest.raises(RunError, match=r"spec\.msgpack cannot be read"), kept_episode(copy, name, "static"):
        pass
    (copy / SPEC_FILE).unlink()
    with pytest.raises(RunError, match="let `readygo evaluate` finish"), kept_episode(copy, name, "static"):
        pass


def test_settings_beside_those_of_the_evaluation_are_refused(folder):
    with pytest.raises(RunError, match=r"leave out --seed, --static, --renderer\.detail\.$"):
        plan(
            PlanOptions(
                scene="test-0-000000",
                from_=folder,
                seed=3,
                episode=PlanEpisodeOptions(static=True, task="static"),
                keys={"renderer": {"detail": "lod"}},
            )
        )
    with pytest.raises(RunError, match="give its folder with --from"):
        plan(PlanOptions(scene="embedded", episode=PlanEpisodeOptions(task="static")))


def test_command_names_episode_task_and_method(tmp_path):
    words = shlex.split(plan_command(tmp_path / "my results", record(4, Outcome.TIMEOUT, task=Task.STATIC)))
    assert words[:4] == ["readygo", "plan", "--from", str(tmp_path / "my results")]
    assert words[4:9] == ["test-0-000004", "--task", "static", "--method", "policy"]
