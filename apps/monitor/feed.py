"""Feeds one episode at a time to viewers: running episodes, else recorded ones."""

import dataclasses
import logging
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from typing import Protocol

import numpy as np

from readygo.apps.monitor.subject import Subject
from readygo.apps.monitor.track import EpisodeTrack, Pictures, on_floor
from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.errors import ReadygoError
from readygo.common.messages import EpisodeKey
from readygo.common.messages.live import LivePerception, LiveState
from readygo.common.robot.kinematics import DT_S

POLL_S = 0.1
AGAIN_S = 2.0
"""Period of repeating constant content, for viewers that have connected since [s]."""
WAIT_S = 3.0
"""Time for a run to show an episode before recorded ones are shown [s]."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveMoment:
    """An episode at one time."""

    state: LiveState
    images: Pictures = dataclasses.field(default_factory=dict)
    """Images that are new since the previous moment, by name."""
    image_format: str = "jpeg"
    way: Float64Array = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))
    """The known path of the robot: x, y, z [m], yaw [rad], shape (N, 4)."""
    perception: LivePerception | None = None
    """What its driver perceives; None if it does not perceive."""


class Sink(Protocol):
    """A viewer."""

    def begin(self, moment: LiveMoment, stamp_ns: int) -> None:
        """Show the content that is constant over an episode; called again periodically."""
        ...

    def show(self, moment: LiveMoment, stamp_ns: int) -> None:
        """Show a moment; `stamp_ns` is the wall clock."""
        ...

    def close(self) -> None:
        """Close the viewer's connection."""
        ...


class Feed:
    """Shows a run in a viewer, on a separate thread."""

    def __init__(self, subject: Subject, sink: Sink) -> None:
        self._subject, self._sink = subject, sink
        self._stop = threading.Event()
        self._shown: EpisodeKey | None = None
        self._begun_s = 0.0
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread, and close the viewer."""
        self._stop.set()
        self._thread.join()
        self._sink.close()

    def _run(self) -> None:
        try:
            for moment in self._moments():
                now_s = time.monotonic()
                stamp_ns = time.time_ns()
                if moment.state.episode != self._shown or now_s - self._begun_s > AGAIN_S:
                    self._shown, self._begun_s = moment.state.episode, now_s
                    self._sink.begin(moment, stamp_ns)
                self._sink.show(moment, stamp_ns)
                if self._stop.is_set():
                    return
        except Exception:
            log.exception("the viewer gets no more")

    def _moments(self) -> Iterator[LiveMoment]:
        while not self._stop.is_set():
            yield from self._live()
            yield from self._recorded_moments()
            self._stop.wait(POLL_S)

    def _live(self) -> Iterator[LiveMoment]:
        """Moments of running episodes, each while new messages arrive; ends if no episode runs."""
        quiet_s, followed, told_ns = 0.0, None, (-1, -1)
        while quiet_s < WAIT_S and not self._stop.is_set():
            with self._subject.watch.lock:
                moving = self._subject.watch.under_way()
                episode = next((m for m in moving if m.episode == followed), moving[0] if moving else None)
                newest = episode.states[-1][1] if episode else None
                preview = episode.previews[-1] if episode and episode.previews else (-1, {})
            if newest is not None and episode is not None:
                if episode.episode != followed:
                    followed, told_ns = episode.episode, (-1, -1)
                if newest.time_ns != told_ns[0]:
                    images = preview[1] if preview[0] != told_ns[1] else {}
                    told_ns, quiet_s = (newest.time_ns, preview[0]), 0.0
                    plan, z_m = episode.plan, newest.robot_xyzyaw[2]
                    way = _poses(plan.robot_xyyaw, z_m) if plan else np.array([newest.robot_xyzyaw])
                    yield LiveMoment(
                        state=newest,
                        images=images,
                        image_format=episode.image_format,
                        way=way,
                        perception=episode.perception,
                    )
            self._stop.wait(POLL_S)
            quiet_s += POLL_S

    def _recorded_moments(self) -> Iterator[LiveMoment]:
        """Moments of recorded episodes, at their pace, until an episode runs."""
        recorded = self._subject.recorded
        for episode in cycle(recorded.episodes() if recorded else ()):
            try:
                track = self._subject.track(episode)
            except ReadygoError as error:
                log.warning("%s", error)
                return
            if track is None:
                return
            for moment in _replay_moments(track):
                yield moment
                if self._stop.wait(2 * DT_S):
                    return
            with self._subject.watch.lock:
                if self._subject.watch.under_way():
                    return


def _replay_moments(track: EpisodeTrack) -> Iterator[LiveMoment]:
    """Every second moment of an episode."""
    way = np.array([state.robot_xyzyaw for state in track.states])
    before: Pictures = {}
    for state in track.states[::2]:
        images = track.images_at(state.time_ns / 1e9)
        yield LiveMoment(
            state=state, images={} if images is before else images, image_format=track.image_format, way=way
        )
        before = images


def _poses(xyyaw: Float32Array, height_m: float) -> Float64Array:
    return np.column_stack([on_floor(xyyaw[:, :2], height_m), xyyaw[:, 2]])
