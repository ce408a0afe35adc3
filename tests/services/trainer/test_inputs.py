import pytest

from readygo.services.trainer.inputs import Fusion, GoalForm, MotionInput, PolicyInputs


def test_paper_policy_takes_latents_of_three_frames_a_command_and_a_goal():
    inputs = PolicyInputs(motion=MotionInput.COMMAND)
    assert (inputs.latents_width, inputs.feature_count, inputs.image_channels) == (60, 65, 3)


@pytest.mark.parametrize(
    ("inputs", "latents", "features", "channels"),
    [
        (PolicyInputs(fusion=Fusion.EARLY, latent_count=64, frame_count=5), 64, 80, 15),
        (PolicyInputs(images=("rgb", "depth"), frame_count=2), 40, 47, 4),
        (PolicyInputs(goal=GoalForm.IMAGE), 80, 88, 3),
        (PolicyInputs(goal=GoalForm.BOTH), 80, 90, 3),
    ],
)
def test_widths_follow_frames_goal_and_fusion(inputs, latents, features, channels):
    assert (inputs.latents_width, inputs.feature_count, inputs.image_channels) == (latents, features, channels)
