from pathlib import Path

from readygo.benchmarks.fleet import rates


def test_every_call_of_every_episode_is_timed(tmp_path: Path) -> None:
    calls = rates.time_coordinator(tmp_path, 3)
    assert {name: len(times) for name, times in calls.items()} == {"claim": 12, "complete": 12, "record": 9}
    assert min(min(times) for times in calls.values()) >= 0.0


def test_rates_follow_from_the_calls() -> None:
    found = rates.coordinator_rates({"claim": [0.001] * 4, "complete": [0.003] * 4, "record": [0.002] * 3})
    assert found["completions_hz"] == 250.0
    assert found["claim_p99_ms"] == 1.0
    assert found["episodes_hz"] == round(1.0 / 0.022, 1)


def test_recorder_is_measured_in_bytes_of_its_shards(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(rates, "INGEST_EPISODES", 1)
    found = rates.recorder_rates(tmp_path)
    assert found["ingest_mb_s"] / found["ingest_samples_hz"] > 0.01, "MB of a sample: its image alone has 14 kB"
