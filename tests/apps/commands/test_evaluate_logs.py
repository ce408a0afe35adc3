import json

import pytest

from readygo.apps.commands.evaluate import EvaluateOptions, TrialOptions, evaluate
from readygo.common.errors import RunError
from tests.apps.drive.test_trials import write_trial


def test_trials_become_a_table(tmp_path, capsys):
    for k in range(10):
        write_trial(tmp_path / f"{k}.mcap", "goal" if k < 7 else "human_collision", measures=LOOP)
    evaluate(EvaluateOptions(out=tmp_path / "out", trials=TrialOptions(from_logs=tmp_path)))
    said = capsys.readouterr().out
    assert "70.0  40-89" in said
    assert "dynamic lobby: 3 drove into a human in plain view" in said
    assert "inference 20.0 Hz (120 Hz possible), image to command 5.0 ms, p99 9.0 ms" in said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["scores"]["dynamic"]["lobby"]["art_s"] == pytest.approx(0.7 * 12.5 + 0.3 * 50)
    assert len(summary["trials"]) == 10
    assert "dynamic & lobby & 70" in (tmp_path / "out" / "table.tex").read_text()
    evaluate(EvaluateOptions(json=True, trials=TrialOptions(from_logs=tmp_path)))
    assert json.loads(capsys.readouterr().out)["loop"]["inference_hz"] == 20.0


def test_settings_beside_those_of_the_logs_are_refused(tmp_path):
    with pytest.raises(RunError, match=r"from the logs: leave out SCENE, --episodes, --seed, --driver\.disturbed\.$"):
        evaluate(
            EvaluateOptions(
                scene="embedded",
                episodes=3,
                trials=TrialOptions(from_logs=tmp_path, seed=1),
                keys={"driver": {"disturbed": 0.1}},
            )
        )


def test_evaluation_of_nothing_is_refused():
    with pytest.raises(RunError, match="Say where: readygo evaluate SCENE POLICY, or --from-logs FOLDER"):
        evaluate(EvaluateOptions())


LOOP = {"inference_hz": 20.0, "inference_hz_possible": 120.0, "latency_median_ms": 5.0, "latency_p99_ms": 9.0}
