"""Plans of runs that learn to perceive."""

from pathlib import Path

from readygo.apps.learn.perceive_plan import PerceivePlan, perceive_settings


def plan_of(out: Path, *scenes: str, minutes: float = 10.0) -> PerceivePlan:
    return PerceivePlan(
        out=out,
        scenes=scenes or ("embedded",),
        config=perceive_settings(None, None),
        minutes=minutes,
        avatars=Path("embedded:test"),
        seed=3,
    )
