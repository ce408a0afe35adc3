"""The page of an extracted avatar: held-out frames, new poses, and what no frame has shown."""

import numpy as np

from readygo.apps.avatar.studio import standing_pose, stride_pose, turntable
from readygo.apps.avatar.walking import contact_sheet, motion_sheet
from readygo.apps.report.page import Block, Meter, PageTable, Paragraph, drawing, fact_table, page, photograph
from readygo.common.arrays import UInt8Array
from readygo.common.avatars import avatar_hash
from readygo.common.drawing.files import quantise
from readygo.services.reconstructor import Extraction, HeldOutPerson

SHOWN_MAX = 12
"""Most held-out frames on the page."""
_DIFFERENCE = 4.0
_UNSEEN_NOTE = 0.25
"""A part of the body of which no frame shows this share is named in a note."""


def extraction_page(extraction: Extraction) -> str:
    """The page as HTML text."""
    avatar, report = extraction.avatar, extraction.report
    return page(
        f"Avatar {avatar.name}",
        f"Extracted from {report['frames']} frames of one person. Held-out frames gave their pose, and nothing else.",
        tiles=_tiles(extraction),
        sections={
            "Held-out frames": _held_out(extraction.held_out),
            "New poses": [
                drawing(
                    motion_sheet(avatar), "A walk at 1.2 m/s, a turn, and a run at 3.2 m/s; time goes to the right."
                ),
                drawing(contact_sheet(avatar), "Four phases of a walk, each from three sides."),
                drawing(turntable(avatar, (standing_pose(), stride_pose())), "Standing and in mid-stride, all around."),
            ],
            "What no frame has shown": _unseen(report["unseen"]),
            "In numbers": [fact_table(_facts(extraction))],
        },
        facts={"avatar": avatar_hash(avatar)},
    )


def notes_of(report: dict[str, object]) -> list[str]:
    """Hints about an extraction for the user."""
    unseen = report["unseen"]
    assert isinstance(unseen, dict)
    hidden = [f"{part} ({share:.0%})" for part, share in unseen.items() if share > _UNSEEN_NOTE]
    notes = report["notes"]
    assert isinstance(notes, list)
    return [*notes, *([f"no frame shows all of {', '.join(hidden)}; record from all sides."] if hidden else [])]


def comparison(held: HeldOutPerson) -> UInt8Array:
    """The filmed person, the avatar, and four times their difference, side by side."""
    difference = _DIFFERENCE * np.abs(held.photo - held.rendered)
    return quantise(np.concatenate([held.photo, held.rendered, difference], axis=2))


def _tiles(extraction: Extraction) -> list[tuple[str, str]]:
    report = extraction.report
    tiles = [(f"{report['height_m']:.2f} m", "tall"), (f"{report['gaussians']:,}", "Gaussians")]
    if report["psnr_db"] is not None:
        tiles += [(f"{report['psnr_db']:.1f} dB", "PSNR in the mask of held-out frames")]
        tiles += [(f"{report['ssim']:.3f}", "SSIM of held-out frames")]
    return [*tiles, (f"{report['seconds'] / 60:.0f} min", "in all")]


def _held_out(held_out: list[HeldOutPerson]) -> list[Block]:
    if not held_out:
        return [Paragraph(text="No frame was held out.")]
    chosen = held_out[:: max(1, -(-len(held_out) // SHOWN_MAX))]
    return [
        photograph(
            comparison(each),
            f"{each.image}: {each.psnr_db:.1f} dB, SSIM {each.ssim:.3f}. Video, avatar, four times their difference.",
        )
        for each in chosen
    ]


def _unseen(shares: dict[str, float]) -> list[Block]:
    rows = [(part, f"{100 * share:.0f} %", Meter(share=share)) for part, share in shares.items()]
    note = Paragraph(text="Such Gaussians have the mean colour of their neighbours.", is_note=True)
    return [PageTable(("Part", "Share of its surface", ""), rows), note]


def _facts(extraction: Extraction) -> list[tuple[str, str]]:
    report = extraction.report
    return [
        ("body that the fit began with", f"{report['body']}, {100 * report['overlap']:.0f} % of the silhouettes"),
        ("steps", f"{report['steps']:,}"),
        ("time", f"{report['seconds']:.0f} s"),
        ("license", extraction.avatar.license),
        *(("note", note) for note in notes_of(report)),
    ]
