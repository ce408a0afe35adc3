"""`readygo card`: writes a dataset card."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.report.card import CAMERAS_FILE, CARD_FILE, FRAMES_FILE, VISITS_FILE, card_text, dataset_summary
from readygo.apps.report.coverage import heat_map
from readygo.apps.report.coverage_numbers import casts_of, measure
from readygo.apps.report.coverage_run import gather
from readygo.apps.terminal import PlainConsole
from readygo.apps.views.recorded import camera_moments, thumbnails
from readygo.common.dataset import Dataset
from readygo.common.drawing.files import jpeg_bytes, write_png
from readygo.common.files import write_whole


@dataclass(frozen=True, kw_only=True)
class CardOptions:
    """Write a dataset card, the README.md of a data folder: counts, balance, pictures, licenses, provenance."""

    data: Positional[Path]
    """Data folder."""
    out: Path | None = None
    """Folder to write it to; the data folder itself by default."""


def card(options: CardOptions) -> None:
    """Write a dataset card, the README.md of a data folder: counts, balance, pictures, licenses, provenance."""
    dataset = Dataset([options.data])
    folder, name = options.out or options.data, options.data.resolve().name
    casts = casts_of(dataset)
    measured = measure(dataset, casts)
    facts = gather(options.data, dataset, casts, measured, "")
    text = card_text(name, dataset, dataset_summary(dataset, options.data), measured)
    write_whole(folder / FRAMES_FILE, jpeg_bytes(thumbnails(dataset, name)))
    if (moments := camera_moments(dataset)) is not None:
        write_whole(folder / CAMERAS_FILE, jpeg_bytes(moments))
    write_png(folder / VISITS_FILE, heat_map(measured.visits, facts.occupancy))
    write_whole(folder / CARD_FILE, text)
    PlainConsole(soft_wrap=True).print(f"Read {folder / CARD_FILE}.", markup=False)
