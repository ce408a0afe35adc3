"""A run of two toy stages: numbers are drawn, and filmed in small pictures."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from readygo.apps.fleet.run import run_in_process
from readygo.common.bus import Bus
from readygo.common.fleet import Inputs, StageResult, Work, append_episode
from readygo.common.messages import ClaimReply, RunSpec, Split, Stage, StatusReply
from readygo.runs.config import RunConfig, resolved_sections
from readygo.runs.folder import RunFolder
from readygo.runs.stages import Entry
from readygo.runs.world import World
from readygo.services.coordinator import CoordinatorConfig
from readygo.services.recorder import RecorderConfig
from tests.common.dataset.episodes import PROVENANCE, make_episode


def entry(stage: Stage, work: Work) -> Entry:
    """A stage whose work needs no world."""
    return Entry(stage=stage, work=lambda world, bus: work)


def draw(claim: ClaimReply, inputs: Inputs) -> StageResult:
    """The number itself."""
    assert claim.episode is not None
    return StageResult(result=str(claim.episode.index).encode())


def film(world: World, bus: Bus) -> Work:
    """An episode of four samples, whose encounter is what was judged."""

    def work(claim: ClaimReply, inputs: Inputs) -> None:
        assert claim.episode is not None
        header, samples = make_episode(claim.episode.index, 4)
        verdict = inputs.get("judge", b"")
        append_episode(bus, claim, dataclasses.replace(header, encounters=(verdict.decode(),)), iter(samples))

    return work


DRAW = entry(Stage(name="draw", role="painter"), draw)
FILM = Entry(stage=Stage(name="film", role="camera", needs=("draw",), records=True), work=film)


def make_folder(
    path: Path, line: Sequence[Entry], *, wanted: int, recorder: RecorderConfig | None = None, **settings: object
) -> RunFolder:
    """A data folder of a run that is to begin."""
    coordinator = CoordinatorConfig(**settings)  # type: ignore[arg-type]
    config = RunConfig(coordinator=coordinator, recorder=recorder or RecorderConfig())
    plain = PROVENANCE.to_mapping()
    spec = RunSpec(
        run="run-test",
        scene_path="nowhere",
        scene_hash="0" * 64,
        scene_files=(),
        avatars_path="",
        avatar_hashes={},
        seed=7,
        split=Split.TRAIN,
        static=False,
        config=resolved_sections(config),
        metadata={key: plain[key] for key in plain.keys() - {"config", "seed", "numeric_class"}},
        stages=tuple(entry.stage for entry in line),
    )
    folder = RunFolder(path)
    with folder.lock():
        folder.save(spec, wanted)
    return folder


def in_process(folder: RunFolder, line: Sequence[Entry], filmed: list[int] | None = None) -> StatusReply:
    """Do the run; `filmed` gets the indices of the episodes that reach the last stage."""

    def noted(world: World, bus: Bus) -> Work:
        work = line[-1].work(world, bus)

        def note(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
            if filmed is not None and claim.episode:
                filmed.append(claim.episode.index)
            return work(claim, inputs)

        return note

    return run_in_process(folder, lambda status: None, [*line[:-1], Entry(stage=line[-1].stage, work=noted)])
