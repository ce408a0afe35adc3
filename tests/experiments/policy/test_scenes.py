"""Arms that differ in nothing but where they learn."""

from experiments.policy.scenes import arms_of


def test_other_flats_are_those_of_the_smaller_arms_and_more() -> None:
    arms = arms_of("embedded", [1, 4])
    assert {name: arm.scenes for name, arm in arms.items()} == {
        "same": ("embedded",),
        "others-1": ("embedded:plan-0",),
        "others-4": ("embedded:plan-0", "embedded:plan-1", "embedded:plan-2", "embedded:plan-3"),
    }
    assert {(arm.settings, arm.crowded) for arm in arms.values()} == {("", True)}
