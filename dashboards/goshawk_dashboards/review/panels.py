"""What stands beside a review's scene: picture, state, candidates, marks, view options. The timeline is the dock's."""

from __future__ import annotations

import numpy as np
import viser

from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.live.candidates import picture_html
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Mark, lattice_columns, takeoff_s
from goshawk_dashboards.page.status import status_html, vehicle_html
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.review import dock, tables
from goshawk_dashboards.review.player import Player
from goshawk_dashboards.review.scene import OthersMode, ReviewOptions
from goshawk_dashboards.scene.cameras import CameraMode
from goshawk_dashboards.scene.scene import ViewOptions
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array, PlanView

JUMP = "jump to …"


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
        has_replay: bool,
        has_others: bool,
        beside: str = "",
    ) -> None:
        """``beside``: how another log lies beside the flight, in words."""
        self._player, self._flight, self._marks = player, flight, marks
        self._stops_s, self._takeoff_s = stops_s, takeoff_s(flight)
        self._mark_stops_s = np.unique([m.time_s for m in marks])
        self._columns: int | None = None
        gui = viewer.gui
        if isinstance(viewer, viser.ClientHandle):
            gui.add_html(dock.seat_html(viewer.client_id))
        self._picture = gui.add_html("")
        self._status = gui.add_html("")
        self._marks_html = gui.add_html("")
        self._add_jump(gui)
        with gui.add_folder("Estimates"):
            self._instruments = gui.add_html("")
        with gui.add_folder("Candidates"):
            self._candidates = gui.add_html("")
        self._add_view(gui, has_replay, has_others)
        with gui.add_folder("Flight", expand_by_default=False):
            gui.add_html(tables.flight_html(flight, beside))
            self._vehicle = gui.add_html("")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        self._add_keys(gui)

    def _add_jump(self, gui: viser.GuiApi) -> None:
        places = {f"{m.time_s:.2f} s  {m.text}": m.time_s for m in self._marks}
        self._jump = gui.add_dropdown("Jump", (JUMP, *places), initial_value=JUMP)

        @self._jump.on_update
        def _(event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
            if event.client is not None and self._jump.value in places:
                self._player.seek(places[self._jump.value])
                self._jump.value = JUMP

    def _add_view(self, gui: viser.GuiApi, has_replay: bool, has_others: bool) -> None:
        with gui.add_folder("View"):
            self._camera = gui.add_dropdown("Camera", ("Follow", "Chase", "Free"), initial_value="Follow")
            self._others = gui.add_dropdown(
                "Other flights", ("Overlaid", "Side by side", "Hidden"), initial_value="Overlaid", visible=has_others
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
        for handle in (*boxes.values(), self._camera, self._others):
            handle.on_update(lambda _: self._player.touch())

    def _add_keys(self, gui: viser.GuiApi) -> None:
        player, add = self._player, gui.add_command
        add("Play or pause", hotkey="space").on_trigger(lambda _: player.toggle())
        add("Previous frame", hotkey="arrowleft").on_trigger(lambda _: player.step(self._stops_s, -1))
        add("Next frame", hotkey="arrowright").on_trigger(lambda _: player.step(self._stops_s, 1))
        add("Previous event", hotkey="arrowup").on_trigger(lambda _: player.step(self._mark_stops_s, -1))
        add("Next event", hotkey="arrowdown").on_trigger(lambda _: player.step(self._mark_stops_s, 1))

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
            # Of frames the review itself draws it in full; what the ground recorded has it only as the map tells it.
            depth=box["depth"] and not self._flight.count("rgbd"),
        )
        others: OthersMode = self._others.value
        return ReviewOptions(view=view, depth=box["depth"], replay=box["replay"], others=others)

    @property
    def camera_mode(self) -> CameraMode:
        """How the viewer's camera moves."""
        return self._camera.value

    def update(self, snap: Snapshot, replayed: PlanView | None, track: Track, *, altered: bool = False) -> None:
        """Shows one instant's figures; what did not change is not sent.

        ``altered``: what was ``replayed`` is the planner's answer to what this viewer altered.
        """
        time_s = snap.now_s
        self._picture.content = picture_html(snap, fresh=snap.fresh("plan"), altered=replayed if altered else None)
        flight_s = time_s - self._takeoff_s
        self._status.content = status_html(
            snap, flight_s=flight_s if flight_s >= 0.0 else None, ground_z_m=track.stood_z_m
        )
        self._instruments.content = panel_html(snap, track)
        self._marks_html.content = tables.marks_html(self._marks, time_s)
        if self._columns is None and snap.plan is not None:
            self._columns = lattice_columns(self._flight, len(snap.plan.cost_N))
        plan = snap.plan if snap.fresh("plan") else None
        self._candidates.content = tables.candidates_html(
            plan, self._columns or 1, replayed, "the altered planner" if altered else "the other policy"
        )
        self._vehicle.content = vehicle_html(snap) if snap.health is not None else ""
