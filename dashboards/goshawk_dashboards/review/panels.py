"""The controls and figures of a review: timeline, jumps, view options; picture, candidates and plots."""

from __future__ import annotations

import numpy as np
import viser

from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Mark, lattice_columns
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.status import learnt_html, status_html, vehicle_html
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.review import html, tables
from goshawk_dashboards.review.html import Window
from goshawk_dashboards.review.player import SPEEDS, Player
from goshawk_dashboards.review.plots import Plot
from goshawk_dashboards.review.scene import ReviewOptions, SecondMode
from goshawk_dashboards.scene.cameras import CameraMode
from goshawk_dashboards.scene.picture import decode_preview
from goshawk_dashboards.scene.scene import ViewOptions
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array, PlanView

WINDOWS: dict[str, float | None] = {"whole flight": None, "60 s": 60.0, "20 s": 20.0, "5 s": 5.0}
JUMP = "jump to …"
PREVIOUS_EVENT, PREVIOUS_FRAME, NEXT_FRAME, NEXT_EVENT = "◀ event", "◀ frame", "frame ▶", "event ▶"


class ReviewPanels:
    """Shows instants to one viewer, and moves their player."""

    def __init__(
        self,
        viewer: Viewer,
        player: Player,
        flight: Flight,
        *,
        marks: tuple[Mark, ...],
        stops_s: Array,
        plots: tuple[Plot, ...],
        has_replay: bool,
        has_second: bool,
    ) -> None:
        self._player, self._flight, self._marks, self._plots = player, flight, marks, plots
        self._stops_s = stops_s
        self._mark_stops_s = np.unique([m.time_s for m in marks])
        self._columns: int | None = None
        self._preview_seq: int | None = None
        self._window: Window | None = None
        gui = viewer.gui
        self._status = gui.add_html("")
        self._marks_html = gui.add_html("")
        self._add_jump(gui)
        with gui.add_folder("Candidates"):
            self._candidates = gui.add_html("")
        self._add_view(gui, has_replay, has_second)
        with gui.add_folder("Flight", expand_by_default=False):
            gui.add_html(tables.flight_html(flight))
            self._learnt = gui.add_html("")
            self._vehicle = gui.add_html("")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        instruments = gui.add_panel()
        with instruments.add_tab("Instruments", viser.Icon.CHART_LINE):
            self._picture = gui.add_image(np.full((192, 320, 3), theme.BACKGROUND, dtype=np.uint8))
            self._plot_window = gui.add_dropdown("Plots show", tuple(WINDOWS), initial_value="whole flight")
            self._plot_window.on_update(lambda _: player.touch())
            self._cursor = gui.add_html("")
            self._plots_html = gui.add_html("")
        instruments.dock_left()
        instruments.set_width(340)
        timeline = gui.add_panel()
        with timeline.add_tab("Timeline", viser.Icon.TIMELINE):
            self._add_timeline(gui)
        timeline.float(x=12.0, y=-12.0, width=520.0)
        self._add_keys(gui)

    def _add_timeline(self, gui: viser.GuiApi) -> None:
        player, flight = self._player, self._flight
        self._band_cursor = gui.add_html("")
        self._whole = Window.around(0.0, None, player.duration_s)
        gui.add_html(html.band_html(flight.phases, flight.fallbacks, self._marks, self._whole))
        end_s = float(max(np.ceil(player.duration_s * 100.0) / 100.0, 0.01))
        self._slider = gui.add_slider("Time, s", 0.0, end_s, 0.01, 0.0)
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space")
        self._steps = gui.add_button_group("Step", (PREVIOUS_EVENT, PREVIOUS_FRAME, NEXT_FRAME, NEXT_EVENT))
        speeds = {f"{s:g} ×": s for s in SPEEDS}
        self._speed = gui.add_dropdown("Speed", tuple(speeds), initial_value="1 ×")

        @self._slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:  # not our own movement of it while playing
                player.scrub(self._slider.value)

        self._play.on_click(lambda _: player.toggle())
        self._steps.on_click(lambda _: self._step(self._steps.value))
        self._speed.on_update(lambda _: player.set_speed(speeds[self._speed.value]))

    def _step(self, which: str) -> None:
        stops_s = self._mark_stops_s if which in (PREVIOUS_EVENT, NEXT_EVENT) else self._stops_s
        self._player.step(stops_s, 1 if which in (NEXT_FRAME, NEXT_EVENT) else -1)

    def _add_jump(self, gui: viser.GuiApi) -> None:
        places = {f"{m.time_s:.2f} s  {m.text}": m.time_s for m in self._marks}
        self._jump = gui.add_dropdown("Jump", (JUMP, *places), initial_value=JUMP)

        @self._jump.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client is not None and self._jump.value in places:
                self._player.seek(places[self._jump.value])
                self._jump.value = JUMP

    def _add_view(self, gui: viser.GuiApi, has_replay: bool, has_second: bool) -> None:
        with gui.add_folder("View"):
            self._camera = gui.add_dropdown("Camera", ("Follow", "Chase", "Free"), initial_value="Follow")
            self._second = gui.add_dropdown(
                "Second flight", ("Overlaid", "Side by side", "Hidden"), initial_value="Overlaid", visible=has_second
            )
            boxes = {
                "rejected": gui.add_checkbox("Rejected candidates", True),
                "remembered": gui.add_checkbox("Remembered obstacles", True, visible=self._flight.count("map") > 0),
                "depth": gui.add_checkbox("Measured depth", self._flight.world is None),
                "replay": gui.add_checkbox("The other policy's choice", True, visible=has_replay),
                "world": gui.add_checkbox("World (simulator)", True, visible=self._flight.world is not None),
                "truth": gui.add_checkbox("True target (simulator)", True, visible=self._flight.count("sim_truth") > 0),
                "trails": gui.add_checkbox("Trails", True),
                "frustum": gui.add_checkbox("Camera frustum", True),
            }
        self._boxes = boxes
        for handle in (*boxes.values(), self._camera, self._second):
            handle.on_update(lambda _: self._player.touch())

    def _add_keys(self, gui: viser.GuiApi) -> None:
        add = gui.add_command
        add("Play or pause", hotkey="space").on_trigger(lambda _: self._player.toggle())
        add("Previous frame", hotkey="arrowleft").on_trigger(lambda _: self._step(PREVIOUS_FRAME))
        add("Next frame", hotkey="arrowright").on_trigger(lambda _: self._step(NEXT_FRAME))
        add("Previous event", hotkey="arrowup").on_trigger(lambda _: self._step(PREVIOUS_EVENT))
        add("Next event", hotkey="arrowdown").on_trigger(lambda _: self._step(NEXT_EVENT))

    @property
    def options(self) -> ReviewOptions:
        """What the viewer asked to see."""
        box = {name: handle.value for name, handle in self._boxes.items()}
        view = ViewOptions(
            rejected=box["rejected"],
            world=box["world"],
            trails=box["trails"],
            truth=box["truth"],
            frustum=box["frustum"],
            remembered=box["remembered"],
        )
        second: SecondMode = self._second.value
        return ReviewOptions(view=view, depth=box["depth"], replay=box["replay"], second=second)

    @property
    def camera_mode(self) -> CameraMode:
        """How the viewer's camera moves."""
        return self._camera.value

    def update(self, snap: Snapshot, replayed: PlanView | None) -> None:
        """Shows one instant's figures; what did not change is not sent."""
        time_s = snap.now_s
        self._slider.value = round(min(time_s, self._slider.max), 2)
        playing = self._player.playing
        if self._play.label != ("Pause" if playing else "Play"):
            self._play.label = "Pause" if playing else "Play"
            self._play.icon = viser.Icon.PLAYER_PAUSE if playing else viser.Icon.PLAYER_PLAY
        self._band_cursor.content = html.band_cursor_html(time_s, self._whole)
        window = Window.around(time_s, WINDOWS[self._plot_window.value], self._player.duration_s)
        if window != self._window:
            self._window = window
            self._plots_html.content = html.plots_html(self._plots, self._flight.phases, window)
        self._cursor.content = html.cursor_html(self._plots, time_s, window)
        self._status.content = status_html(snap)
        self._marks_html.content = tables.marks_html(self._marks, time_s)
        if self._columns is None and snap.plan is not None:
            self._columns = lattice_columns(self._flight, len(snap.plan.cost_N))
        plan = snap.plan if snap.fresh("plan") else None
        self._candidates.content = tables.candidates_html(plan, self._columns or 1, replayed)
        self._learnt.content = learnt_html(snap)
        self._vehicle.content = vehicle_html(snap) if snap.health is not None else ""
        if snap.preview is not None and snap.preview.seq != self._preview_seq:
            self._preview_seq = snap.preview.seq
            picture = decode_preview(snap.preview)
            if picture is not None:
                self._picture.image = enlarged(picture)


def enlarged(picture: np.ndarray, width: int = 320) -> np.ndarray:
    """A small picture with each pixel repeated to about ``width``: what the network sees, not smoothed."""
    times = max(1, width // picture.shape[1])
    return picture.repeat(times, axis=0).repeat(times, axis=1)
