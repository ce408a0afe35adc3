import pytest

from readygo.services.animator import AnimatorConfig
from readygo.services.animator.priormdm.config import PriorMdmConfig


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"refine": "most"}, 'refine must be "none", "limits" or "prior", got \'most\''),
        ({"refine": "prior"}, "go together"),
        ({"refine": "limits", "pose_prior": "gmm_08.pkl"}, "go together"),
    ],
)
def test_refinements_that_do_not_fit_together_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        PriorMdmConfig(**change)


def test_source_without_files_says_which_and_where_from():
    with pytest.raises(
        ValueError, match=r"priormdm.weights, priormdm.mean, priormdm.std;.*HumanML3D.*\"gait\""
    ) as error:
        AnimatorConfig(source="priormdm")
    assert "\n" not in str(error.value)


def test_steps_outside_of_their_range_are_refused():
    with pytest.raises(ValueError, match=r"priormdm\.steps must be within"):
        PriorMdmConfig(steps=-1)
