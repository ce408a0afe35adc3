"""Training while episodes are made: what a fleet commits is learned from, what is learned is offered to it."""

import dataclasses
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from readygo.common.camera import SensorConfig
from readygo.common.documents import read_json, write_json
from readygo.common.errors import BusError, PeerError, PolicyError
from readygo.common.messages import CommittedEpisode, OfferReply, OfferRequest, PolicyFile
from readygo.common.messages.live import LiveLoss
from readygo.common.messages.plan import DriverKind, Outcome
from readygo.common.policy.artifact import POLICY_FILES
from readygo.common.robot import RobotConfig
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.episodes import TrainingEpisode, committed_episode
from readygo.services.trainer.history import DECAY_FILE, PROGRESS_FILE
from readygo.services.trainer.outcome import export_chosen, write_outcome
from readygo.services.trainer.parts import HELD_OUT_SHARE, EpisodePart, outputs_of
from readygo.services.trainer.run import TrainRun
from readygo.services.trainer.samples import name_rank

STOP_FILE = "stop"
"""A file of this name in the run's folder ends training as SIGTERM does; it is removed then."""
CANDIDATES_FOLDER = "candidates"
"""One folder per offered policy, by its number."""
FIRST_EPISODES = 8
"""Training begins with this many episodes."""
CATCH_UP_EVERY_S = 60.0
"""Time between looks into the data folders for episodes that were not heard [s]."""
WAITING_MAX = 256
"""Heard episodes that wait for the trainer; the oldest ones give way."""
REFUSALS_MAX = 3
"""Policies that the fleet may refuse before training ends."""
RECENT = 100
"""Episodes that a success rate is taken over."""
PROGRESS_EVERY_S = 5.0
WAIT_S = 0.2

Offer = Callable[[OfferRequest], OfferReply]
Show = Callable[[LiveLoss], None]
CatchUp = Callable[[], Iterable[tuple[str, CommittedEpisode]]]
"""Episodes that are durable and were not given before, each with the name of its run."""

_log = logging.getLogger(__name__)


class LiveTrainer:
    """Trains on what it hears, for as long as it is let."""

    def __init__(
        self,
        robot: RobotConfig,
        sensor: SensorConfig,
        config: TrainConfig,
        out: Path,
        *,
        offer: Offer,
        catch_up: CatchUp = tuple,
        show: Show = lambda loss: None,
    ) -> None:
        """Begin, or resume from the checkpoint in `out`; episodes come from `hear` and `catch_up`.

        Args:
            robot: The fleet's robot.
            sensor: What varies of its camera.
            config: Budget and settings.
            out: Folder of the run.
            offer: Gives a policy to the fleet.
            catch_up: Reads what was not heard; asked at first, and then every `CATCH_UP_EVERY_S`.
            show: Hears every new entry of the history.

        Raises:
            PolicyError: If `out` belongs to a run with other settings.
        """
        self._robot, self._config, self._offer, self._catch_up = robot, config, offer, catch_up
        self._parts = EpisodePart(robot, config, 1 - HELD_OUT_SHARE), EpisodePart(robot, config, HELD_OUT_SHARE)
        self._run = TrainRun(self._parts, robot, sensor, config, out, data={"source": "live"})
        self._show, self._shown = show, len(self._run.history)
        self._size_px = robot.camera.height_px, robot.camera.width_px
        self._heard: deque[tuple[str, CommittedEpisode]] = deque(maxlen=WAITING_MAX)
        self._seen: set[str] = set()
        self._refusals = 0
        self._recent = {name: deque[bool](maxlen=RECENT) for name in ("static", "dynamic")}
        self._offers: list[dict[str, Any]] = _earlier_offers(out)
        self._offered_s, self._told_s, self._caught_up_s = self._run.elapsed_s, 0.0, 0.0

    def hear(self, name: str, message: CommittedEpisode) -> None:
        """Take an episode of the run `name`, from any thread; returns at once."""
        self._heard.append((name, message))

    def train(self, stop: threading.Event) -> dict[str, Any]:
        """Train until the budget is spent, `stop` is set or the stop file is there; then export.

        Returns:
            What `metrics.json` holds; nothing if there was nothing to train on.

        Raises:
            PolicyError: If the loss is not finite, or the fleet cannot use the policies.
        """
        self._read()
        while not (stop.is_set() or self._is_requested(STOP_FILE) or self._run.is_over):
            self._listen()
            if len(self._parts[0].reservoir.episodes) < FIRST_EPISODES:
                self._tell("waiting")
                stop.wait(WAIT_S)
                continue
            if self._is_requested(DECAY_FILE):
                self._run.schedule.begin_decay(self._run.fraction)
            self._run.step()
            if self._run.elapsed_s - self._offered_s >= self._config.offer_every_s:
                self._give()
            self._tell("training")
        return self._end()

    def _end(self) -> dict[str, Any]:
        for name in (STOP_FILE, DECAY_FILE):
            (self._run.out / name).unlink(missing_ok=True)
        metrics: dict[str, Any] = {}
        if self._run.steps:
            self._run.finish()
            metrics = write_outcome(self._run)
        self._tell("ended", now=True)
        return metrics

    def _listen(self) -> None:
        while self._heard:
            self._take([self._heard.popleft()])
        if time.monotonic() - self._caught_up_s > CATCH_UP_EVERY_S:
            self._read()
            self._caught_up_s = time.monotonic()

    def _read(self) -> None:
        """Take what was not heard, and say so: who watches must not take minutes of it for a trainer that is frozen."""
        for each in self._catch_up():
            self._take([each])
            self._tell("reading")

    def _take(self, committed: Iterable[tuple[str, CommittedEpisode]]) -> None:
        for run, message in committed:
            name = f"{run}/{message.header.episode.episode_id}"
            if name in self._seen or not message.samples:
                continue
            self._seen.add(name)
            if (message.header.height_px, message.header.width_px) != self._size_px:
                _log.warning("Episode %s has images of another size and is left out.", name)
                continue
            self._keep(
                dataclasses.replace(committed_episode(message, self._robot, outputs_of(self._config)), name=name)
            )

    def _keep(self, episode: TrainingEpisode) -> None:
        held_out = name_rank(episode.name) < self._config.validation_fraction
        self._parts[held_out].reservoir.add(episode)
        if episode.driver is DriverKind.POLICY:
            self._recent["static" if episode.static else "dynamic"].append(episode.outcome is Outcome.SUCCESS)

    def _give(self) -> None:
        """Offer the averaged weights to the fleet; one that does not answer is offered the next ones."""
        run = self._run
        self._offered_s = run.elapsed_s
        folder = run.out / CANDIDATES_FOLDER / f"{len(self._offers):05d}"
        export_chosen(run, folder)
        files = tuple(PolicyFile(name=name, data=(folder / name).read_bytes()) for name in POLICY_FILES)
        entry: dict[str, Any] = {"step": run.steps, "samples": run.samples_seen, "minutes": run.elapsed_s / 60}
        try:
            reply = self._offer(OfferRequest(files=files))
        except BusError as error:
            self._refusals += isinstance(error, PeerError)
            if self._refusals == REFUSALS_MAX:
                raise PolicyError(f"The fleet cannot use what is trained for it: {error}") from error
            _log.warning("The policy of step %d was not taken: %s", run.steps, error)
        else:
            self._refusals = 0
            entry |= {"version": reply.version, "sha256": reply.sha256}
        self._offers.append(entry | {"folder": str(folder.relative_to(run.out))})
        self._tell("training", now=True)

    def _tell(self, state: str, *, now: bool = False) -> None:
        """Write how far training is."""
        if not now and time.monotonic() - self._told_s < PROGRESS_EVERY_S:
            return
        self._told_s, run = time.monotonic(), self._run
        mapping = {
            "state": state,
            "fraction": run.progress().fraction,
            "minutes": run.elapsed_s / 60,
            "steps": run.steps,
            "samples": run.samples_seen,
            "episodes": {
                name: len(part.reservoir.episodes)
                for name, part in zip(("training", "held_out"), self._parts, strict=True)
            },
            "success": {
                name: {"episodes": len(recent), "rate": sum(recent) / len(recent) if recent else None}
                for name, recent in self._recent.items()
            },
            "offers": self._offers,
            "history": run.history,
        }
        write_json(run.out / PROGRESS_FILE, mapping, raises=PolicyError)

        self._show_new(run.history)

    def _show_new(self, history: Sequence[Mapping[str, float]]) -> None:
        """Show what has come to the history since the last time."""
        for entry in history[self._shown :]:
            loss = LiveLoss(
                steps=int(entry["step"]),
                samples=int(entry["samples"]),
                train_loss=entry["train_loss"],
                validation_loss=entry["validation_loss"],
                success_rate=entry.get("success_rate"),
            )
            self._show(loss)
        self._shown = len(history)

    def _is_requested(self, file: str) -> bool:
        return (self._run.out / file).exists()


def _earlier_offers(out: Path) -> list[dict[str, Any]]:
    """The earlier offers of a run that resumes."""
    try:
        offers: list[dict[str, Any]] = read_json(out / PROGRESS_FILE)["offers"]
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return offers
