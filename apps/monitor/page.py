"""The page of one browser, with its user's choices; other browsers have independent pages."""

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from readygo.apps.monitor import panels
from readygo.apps.monitor.actors import ACCENTS, Actor, eye_of
from readygo.apps.monitor.splats import DollsHouse, Splats
from readygo.apps.monitor.subject import Subject
from readygo.apps.monitor.track import EpisodeTrack, Pictures, between, on_floor
from readygo.apps.monitor.watch import Moving
from readygo.common.errors import ReadygoError
from readygo.common.images.encoded import decode_image
from readygo.common.images.names import RGB, camera_of, kind_of
from readygo.common.messages import EpisodeKey, Outcome
from readygo.common.messages.live import LiveState

LIVE = "live"
OVERVIEW, FOLLOW, EYES = "Overview", "Follow", "Robot's eyes"
CAST_MAX = 8
"""Largest number of episodes that are shown at the same time."""
CHOICES_MAX = 300
"""Largest number of episodes in the list, the newest ones."""
PANELS_S, CHARTS_S, EPISODES_S = 0.5, 2.0, 4.0
"""Refresh periods of panels, charts and the list of episodes [s]."""
MARKS = {None: "", Outcome.SUCCESS: " ✓", Outcome.TIMEOUT: " ⏱"}
FOLLOW_BACK_M, FOLLOW_UP_M = 1.9, 3.2
SMOOTH_S = 0.5
"""Time constant of a follow camera's motion [s]."""


class Page:
    """Content of one browser; one thread calls `update` several times a second."""

    def __init__(self, client: Any, subjects: list[Subject]) -> None:
        """Build the page.

        Args:
            client: The viewer's handle.
            subjects: Runs to choose from, at least one.
        """
        self._client, self._subjects = client, subjects
        self._subject = subjects[0]
        self._lock = threading.Lock()
        self._due_s: dict[str, float] = {}
        self._cast: dict[str, Actor] = {}
        self._keys: dict[str, EpisodeKey] = {}
        self._track: EpisodeTrack | None = None
        self._time_s = 0.0
        self._before_s: float | None = None
        self._followed = ""
        self._camera_yaw: float | None = None
        self._free_fov: float | None = None
        self._house: DollsHouse | None = None
        self._splats: dict[str, Any] = {}
        self._pictured: dict[str, Pictures] = {}
        self._marks: dict[str, tuple[Pictures, Pictures]] = {}
        """The newest images of each worker, and the same with what its driver perceived."""
        self._count, self._begun = 0, False
        with client.atomic():
            self._build()
            self._enter(self._subject)

    def update(self, now_s: float) -> None:
        """Show the current state of the run."""
        with self._lock, self._client.atomic():
            if self._house is None and self._subject.house is not None:
                self._put_up(self._subject.house)
            self._list_episodes(now_s)
            states = self._play(now_s) if self._track is not None else self._live(now_s)
            self._aim_camera(states, now_s)
            self._tell(now_s, states)
            self._before_s = now_s

    def _build(self) -> None:
        gui = self._client.gui
        self._head = gui.add_html("")
        if len(self._subjects) > 1:
            chosen = gui.add_dropdown("Scene", [subject.name for subject in self._subjects])
            chosen.on_update(_by_hand(lambda: self._choose_subject(chosen.value)))
        tabs = gui.add_tab_group()
        with tabs.add_tab("Watch"):
            self._episode = gui.add_dropdown("Episode", [LIVE], initial_value=LIVE)
            self._view = gui.add_button_group("Camera", [OVERVIEW, FOLLOW, EYES])
            self._clock = gui.add_slider("Time [s]", 0.0, 1.0, 0.05, 0.0, visible=False)
            self._plays = gui.add_checkbox("Play", True, visible=False)
            self._moment = gui.add_html("")
            self._picture = gui.add_html("")
            self._roof = gui.add_checkbox("Ceiling", False)
        with tabs.add_tab("Cameras"):
            self._cameras = gui.add_html("")
        with tabs.add_tab("Charts"):
            self._charts = gui.add_html("")
        with tabs.add_tab("Workers"):
            self._workers = gui.add_html("")
        self._camera_mode = OVERVIEW
        self._view.on_click(lambda _: self._choose_camera(self._view.value))
        self._episode.on_update(_by_hand(lambda: self._choose_episode(self._episode.value)))
        self._clock.on_update(_by_hand(self._scrub))
        self._roof.on_update(lambda _: self._show_roof())

    def _enter(self, subject: Subject) -> None:
        """Switch to a run: show its scene from above, and its state."""
        self._leave()
        self._subject, self._house = subject, None
        self._due_s.clear()

    def _put_up(self, house: DollsHouse) -> None:
        """Show the scene once it is loaded."""
        self._house = house
        for name, splats in (("open", house.open), ("roof", house.roof)):
            if len(splats.centers_m):
                self._splats[name] = self._add_splats(name, splats)
        self._show_roof()
        self._look_from_above()

    def _leave(self) -> None:
        for actor in self._cast.values():
            actor.hide()
        self._cast.clear()
        while self._splats:
            self._splats.popitem()[1].remove()
        self._track, self._keys, self._followed, self._begun = None, {}, "", False
        self._pictured.clear()
        self._marks.clear()

    def _add_splats(self, name: str, splats: Splats) -> Any:
        return self._client.scene.add_gaussian_splats(
            f"/scene/{name}", splats.centers_m, splats.covariances_m2, splats.rgb, splats.opacities
        )

    def _show_roof(self) -> None:
        if "roof" in self._splats:
            self._splats["roof"].visible = self._roof.value or self._camera_mode == EYES

    def _choose_subject(self, name: str) -> None:
        subject = next(subject for subject in self._subjects if subject.name == name)
        with self._lock, self._client.atomic():
            self._enter(subject)

    def _choose_camera(self, mode: str) -> None:
        with self._lock:
            self._camera_mode, self._camera_yaw = mode, None
            if mode == EYES:
                self._free_fov = self._free_fov or self._client.camera.fov
            elif self._free_fov is not None:
                self._client.camera.fov, self._free_fov = self._free_fov, None
            if mode == OVERVIEW:
                self._look_from_above()
            self._show_roof()

    def _choose_episode(self, label: str) -> None:
        """Show a chosen episode from its beginning, or the running ones."""
        key = self._keys.get(label)
        try:
            track = self._subject.track(key) if key is not None else None
        except ReadygoError as error:
            self._client.add_notification("This episode cannot be read", str(error), color="red")
            return
        with self._lock, self._client.atomic():
            for actor in self._cast.values():
                actor.hide()
            self._cast.clear()
            self._track, self._time_s = track, 0.0
            self._clock.visible = self._plays.visible = track is not None
            if track is not None:
                self._clock.max = max(track.duration_s, 0.05)

    def _scrub(self) -> None:
        with self._lock:
            self._time_s = float(self._clock.value)
            self._plays.value = False

    def _list_episodes(self, now_s: float) -> None:
        """Update the list of recorded episodes; if no episode is live, the first one plays."""
        if not self._is_due("episodes", now_s, EPISODES_S):
            return
        watch, recorded = self._subject.watch, self._subject.recorded
        with watch.lock:
            ended: dict[EpisodeKey, Outcome | None] = {
                key: moving.commit.outcome for key, moving in watch.moving.items() if moving.commit and moving.states
            }
        if recorded is not None:
            ended = recorded.episodes()
        self._count = len(ended)
        newest = list(ended.items())[-CHOICES_MAX:]
        self._keys = {f"{key.episode_id}{MARKS.get(outcome, ' ✗')}": key for key, outcome in newest}
        options = [LIVE, *self._keys]
        if list(self._episode.options) != options:
            kept = self._episode.value
            if kept not in options:
                key = kept.split(" ")[0]
                kept = next((label for label in options if label.startswith(key)), LIVE)
            self._episode.options = options
            if self._episode.value != kept:
                self._episode.value = kept
        idle = self._track is None and watch.connection and not self._cast
        if idle and self._keys and not self._begun:
            self._begun = True
            self._episode.value = options[1]
            threading.Thread(target=self._choose_episode, args=(options[1],), daemon=True).start()

    def _play(self, now_s: float) -> dict[str, LiveState]:
        """Show the chosen episode at its time, which advances while it plays."""
        track = self._track
        assert track is not None
        if self._plays.value and self._before_s is not None:
            self._time_s += now_s - self._before_s
            if self._time_s > track.duration_s + 1.0:
                self._time_s = 0.0
            self._clock.value = round(min(self._time_s, track.duration_s), 2)
        state = track.at(self._time_s)
        actor = self._actor("0", 0)
        ways = _human_ways(track)
        actor.plan(track.way, track.replans, ways, of=track.episode)
        actor.show(state, f"#{track.episode.index}", trail=False)
        self._hang(actor, "0", track.images_at(self._time_s))
        return {"0": state}

    def _live(self, now_s: float) -> dict[str, LiveState]:
        """Show the running episodes."""
        with self._subject.watch.lock:
            moving = self._subject.watch.under_way()[:CAST_MAX]
            shown = {episode.worker: (episode, _now(episode, now_s)) for episode in moving}
        for worker in set(self._cast) - set(shown):
            self._cast.pop(worker).hide()
        for number, (worker, (episode, state)) in enumerate(shown.items()):
            actor = self._actor(worker, number)
            self._draw_plan(actor, episode, state)
            actor.show(state, f"{worker} · #{state.episode.index}")
            actor.perceive(episode.perception)
            if episode.previews:
                self._hang(actor, worker, self._marked(episode))
        return {worker: state for worker, (_, state) in shown.items()}

    def _actor(self, name: str, number: int) -> Actor:
        if name not in self._cast:
            accent = ACCENTS[number % len(ACCENTS)]
            self._cast[name] = Actor(self._client.scene, f"/robots/{name}", self._subject.robot, accent)
        return self._cast[name]

    def _draw_plan(self, actor: Actor, episode: Moving, state: LiveState) -> None:
        height_m, plan = state.robot_xyzyaw[2], episode.plan
        if plan is None:
            actor.plan(np.zeros((0, 3)), np.zeros((0, 3)), of=episode.episode)
            return
        way = on_floor(plan.robot_xyyaw[:, :2], height_m)
        humans = tuple(on_floor(human, height_m) for human in plan.humans_xy_m)
        actor.plan(way, way[plan.replanned], humans, of=plan)

    def _hang(self, actor: Actor, name: str, images: Pictures) -> None:
        if images and self._pictured.get(name) is not images:
            self._pictured[name] = images
            for image_name, image in images.items():
                if kind_of(image_name) == RGB:
                    actor.picture(camera_of(image_name), decode_image(image))

    def _marked(self, episode: Moving) -> Pictures:
        """The newest images, with what the driver perceived in them."""
        (time_ns, images), perception = episode.previews[-1], episode.perception
        if perception is None or perception.time_ns != time_ns:
            return images
        if self._marks.get(episode.worker, (None, images))[0] is not images:
            self._marks[episode.worker] = images, panels.mark_people(images, perception, self._subject.robot)
        return self._marks[episode.worker][1]

    def _aim_camera(self, states: dict[str, LiveState], now_s: float) -> None:
        """Move a follow camera; it stays with one robot while messages about that robot arrive."""
        if self._camera_mode == OVERVIEW or not states:
            for actor in self._cast.values():
                actor.eyes = False
            return
        if self._followed not in states:
            self._followed, self._camera_yaw = next(iter(states)), None
        state, camera = states[self._followed], self._client.camera
        for name, actor in self._cast.items():
            actor.eyes = self._camera_mode == EYES and name == self._followed
        if self._camera_mode == EYES:
            self._look_through(state, camera)
            return
        x, y, z, yaw = state.robot_xyzyaw
        before = yaw if self._camera_yaw is None else self._camera_yaw
        share = min(1.0, (now_s - (self._before_s or now_s)) / SMOOTH_S)
        turn = before + share * math.remainder(yaw - before, math.tau)
        self._camera_yaw = turn
        ahead = np.array([math.cos(turn), math.sin(turn), 0.0])
        base = np.array([x, y, z])
        camera.position = base - FOLLOW_BACK_M * ahead + [0.0, 0.0, FOLLOW_UP_M]
        camera.look_at = base + 1.2 * ahead + [0.0, 0.0, 0.3]

    def _look_through(self, state: LiveState, camera: Any) -> None:
        config = self._subject.robot.camera
        T_world_camera = eye_of(config, state)
        camera.position = T_world_camera[:3, 3]
        camera.look_at = T_world_camera[:3, 3] + T_world_camera[:3, 2]
        aspect = config.width_px / config.height_px
        camera.fov = 2 * math.atan(math.tan(min(state.horizontal_fov_rad, 3.0) / 2) / aspect)

    def _look_from_above(self) -> None:
        house, camera = self._house, self._client.camera
        if house is None:
            return
        # Narrow windows need more distance for the same width. The panel covers their lower part, and the right part of
        # wide ones: the scene moves to the free part.
        wide = camera.aspect > 1.0
        far_m = house.radius_m * (1.45 if wide else 1.25 / max(camera.aspect, 0.4))
        aside = 0.42 * np.array([0.62, -0.35, 0.0] if wide else [-0.35, -0.62, 0.0])
        aim = house.center_m + far_m * aside
        camera.position = aim + far_m * np.array([-0.35, -0.62, 0.95])
        camera.look_at = aim

    def _tell(self, now_s: float, states: dict[str, LiveState]) -> None:
        """Update the texts and charts that are due."""
        subject, watch = self._subject, self._subject.watch
        if self._is_due("panels", now_s, PANELS_S):
            with watch.lock:
                _put(self._head, panels.header(subject.name, watch, self._count, subject.notes))
                _put(self._cameras, panels.cameras(watch.workers.values(), subject.robot))
                _put(self._workers, panels.workers(watch))
            self._tell_moment(states)
        if self._is_due("charts", now_s, CHARTS_S):
            losses, success = subject.losses(), subject.success()
            with watch.lock:
                parts = (
                    panels.stages(watch.status, watch.spec),
                    panels.charts(watch),
                    panels.learning(losses, success),
                    panels.evaluations(watch),
                )
            _put(self._charts, panels.html(*parts) if any(parts) else panels.sentence("Numbers appear with a fleet."))

    def _tell_moment(self, states: dict[str, LiveState]) -> None:
        name = self._followed if self._followed in states else next(iter(states), "")
        if not name:
            _put(self._moment, panels.sentence("No episode is under way."))
            _put(self._picture, "")
            return
        kind = self._track.image_format if self._track else "jpeg"
        _put(self._moment, panels.moment(states[name], self._track, "" if self._track else name))
        _put(self._picture, panels.pictures(self._pictured.get(name, {}), kind, self._subject.robot))

    def _is_due(self, what: str, now_s: float, every_s: float) -> bool:
        if now_s - self._due_s.get(what, float("-inf")) < every_s:
            return False
        self._due_s[what] = now_s
        return True


def _by_hand(act: Callable[[], None]) -> Callable[[Any], None]:
    """A callback that runs when the user changes a control, not when the page sets it."""

    def on_click(event: Any) -> None:
        if event.client is not None:
            act()

    return on_click


def _now(episode: Moving, now_s: float) -> LiveState:
    """The displayed state of a live episode, interpolated towards the newest state."""
    if len(episode.states) < 2:
        return episode.states[-1][1]
    (before_s, before), (after_s, after) = episode.states[-2], episode.states[-1]
    return between(before, after, (now_s - after_s) / max(after_s - before_s, 1e-3))


def _human_ways(track: EpisodeTrack) -> tuple[Any, ...]:
    count = min((len(state.humans_xyzyaw) for state in track.states), default=0)
    return tuple(np.array([state.humans_xyzyaw[k][:3] for state in track.states]) for k in range(count))


def _put(handle: Any, content: str) -> None:
    if handle.content != content:
        handle.content = content
