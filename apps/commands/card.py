"""`readygo card`: writes a dataset card."""

from pathlib import Path

from readygo.apps.report.card import CAMERAS_FILE, CARD_FILE, FRAMES_FILE, VISITS_FILE, card_text, dataset_summary
from readygo.apps.report.coverage import heat_map
from readygo.apps.report.coverage_numbers import casts_of, measure
from readygo.apps.report.coverage_run import gather
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.recorded import camera_moments, thumbnails
from readygo.common.dataset import Dataset
from readygo.common.drawing.files import jpeg_bytes, write_png
from readygo.common.files import write_whole


def card(data: Path, /, *, out: Path | None = None) -> None:
    """Write a dataset card, the README.md of a data folder: counts, balance, pictures, licenses, provenance.

    Args:
        data: Data folder.
        out: Folder to write it to; the data folder itself by default.

    Raises:
        DatasetError: If there is no readable dataset.
        ReadygoError: If the card cannot be written.
    """
    dataset = Dataset([data])
    folder, name = out or data, data.resolve().name
    casts = casts_of(dataset)
    measured = measure(dataset, casts)
    facts = gather(data, dataset, casts, measured, "")
    text = card_text(name, dataset, dataset_summary(dataset, data), measured)
    write_whole(folder / FRAMES_FILE, jpeg_bytes(thumbnails(dataset, name)))
    if (moments := camera_moments(dataset)) is not None:
        write_whole(folder / CAMERAS_FILE, jpeg_bytes(moments))
    write_png(folder / VISITS_FILE, heat_map(measured.visits, facts.occupancy))
    write_whole(folder / CARD_FILE, text)
    PlainConsole(soft_wrap=True).print(f"Read {folder / CARD_FILE}.", markup=False)
