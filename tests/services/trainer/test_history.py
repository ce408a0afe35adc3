from readygo.services.trainer.history import loss_curves

HISTORY = [
    {"samples": 640, "train_loss": 0.5, "validation_loss": 0.75},
    {"samples": 1280, "train_loss": 0.25, "validation_loss": 0.5},
]


def test_both_losses_lie_over_the_samples() -> None:
    training, held_out = loss_curves(HISTORY)
    assert (training.name, held_out.name) == ("training", "held out")
    assert training.x.tolist() == held_out.x.tolist() == [640.0, 1280.0]
    assert (training.y.tolist(), held_out.y.tolist()) == ([0.5, 0.25], [0.75, 0.5])


def test_there_are_no_curves_before_the_first_record() -> None:
    assert loss_curves([]) == []
