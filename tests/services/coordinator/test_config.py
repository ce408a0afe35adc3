import pytest

from readygo.services.coordinator import CoordinatorConfig


@pytest.mark.parametrize(
    "wrong",
    [
        {"lease_s": 0.0},
        {"plan_ahead": 0},
    ],
)
def test_numbers_must_be_positive(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}.* must be positive"):
        CoordinatorConfig(**wrong)


def test_smallest_numbers_are_taken() -> None:
    config = CoordinatorConfig(lease_s=0.1, plan_ahead=1)
    assert (config.lease_s, config.plan_ahead) == (0.1, 1)


@pytest.mark.parametrize("names", [(), ("rec0", "rec1", "rec0")])
def test_recorders_must_have_names_of_their_own(names: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="recorders must be different names, at least one"):
        CoordinatorConfig(recorders=names)
