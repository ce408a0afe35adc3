from pathlib import Path

from readygo.apps.coverage.card import card_text
from readygo.apps.coverage.summary import dataset_summary
from readygo.common.dataset import Dataset
from tests.apps.coverage.drives import measured


def test_card_says_counts_balance_licenses_and_origin(data: Path) -> None:
    dataset = Dataset([data])
    text = card_text("plaza", dataset, dataset_summary(dataset, data), measured(data))
    assert text.startswith("---\ntask_categories:\n- robotics\n")
    assert "# plaza\n" in text
    assert "3 episodes of a robot that drives to goals among people: 60 samples" in text
    assert "| outcome | success | 3 | 100 % |" in text
    assert "| encounter | crossing | 2 | 67 % |" in text
    assert "| scene | plaza | CC0 |" in text
    assert f"`{dataset.content_hash}`" in text
    assert str(data) not in text
