"""The panels beside the 3-D view: status, commands, readiness, links, events, view options; picture and plots."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import viser

from goshawk_dashboards import candidates_html, fleet_html, link_html, overlay, plots
from goshawk_dashboards import panels_html as html
from goshawk_dashboards.alerts import Alert, AlertBoard
from goshawk_dashboards.cameras import CameraMode
from goshawk_dashboards.commands import Commands, Watched
from goshawk_dashboards.scene import PLAN_STALE_S, ViewOptions
from goshawk_dashboards.snapshot import Snapshot

MAX_ALERTS = 4
"""Lines of the banner; the worst come first, and the rest is counted."""


class LivePanels:
    """Shows snapshots in a viser server's GUI. All viewers of a server see the same vehicle in full."""

    def __init__(
        self,
        server: viser.ViserServer,
        vehicles: Sequence[Watched],
        *,
        on_select: Callable[[], None],
        on_clear: Callable[[], None],
    ) -> None:
        self._server = server
        self._vehicles = vehicles
        self._boards = [AlertBoard() for _ in vehicles]
        self._on_select = on_select
        self.shown = 0
        """Index of the vehicle shown in full."""
        self._wanted = 0
        gui = server.gui
        self._overlay = gui.add_html("")
        self._fleet = self._make_fleet() if len(vehicles) > 1 else None
        self._status = gui.add_html("")
        self.commands = Commands(server, vehicles, shown=lambda: self.shown)
        self._command = gui.add_html("")
        with gui.add_folder("Readiness"):
            self._readiness = gui.add_html("")
        with gui.add_folder("Link"):
            self._link = gui.add_html("")
        self._radio_folder = gui.add_folder("Autopilot by radio", visible=False)
        with self._radio_folder:
            self._radio = gui.add_html("")
        with gui.add_folder("Events"):
            self._events = gui.add_html("")
        with gui.add_folder("Vehicle", expand_by_default=False):
            self._vehicle = gui.add_html("")
        self._make_view_options(on_clear)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        self._make_instruments()

    def _make_fleet(self) -> viser.GuiHtmlHandle:
        """A table of all vehicles, and two buttons for each."""
        gui = self._server.gui
        table = gui.add_html("")
        with gui.add_folder("Vehicles"):
            for k, vehicle in enumerate(self._vehicles):
                group = gui.add_button_group(vehicle.name, ("Show", "Stop"))

                @group.on_click
                def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle], k: int = k) -> None:
                    if event.target.value == "Show":
                        self.show(k)
                    else:
                        self._vehicles[k].on_stop()

        return table

    def _make_view_options(self, on_clear: Callable[[], None]) -> None:
        gui = self._server.gui
        with gui.add_folder("View", expand_by_default=False):
            self._camera = gui.add_dropdown("Camera", ("Follow", "Chase", "Free"), initial_value="Follow")
            self._rejected = gui.add_checkbox("Rejected candidates", True)
            self._detections = gui.add_checkbox("Detections", True)
            self._trails = gui.add_checkbox("Trails", True)
            self._frustum = gui.add_checkbox("Camera frustum", True)
            self._world = gui.add_checkbox("World (simulator)", True)
            self._truth = gui.add_checkbox("True target (simulator)", True)
            gui.add_button("Clear trails").on_click(lambda _: on_clear())

    def _make_instruments(self) -> None:
        server = self._server
        instruments = server.gui.add_panel()
        first = instruments.add_tab("Instruments", viser.Icon.CHART_LINE)
        with first:
            self._picture = server.gui.add_html("")
            self._strip = server.gui.add_html("")
            server.gui.add_html(plots.legend_html())
        motion = plots.PlotGroup(server, first, plots.MOTION, plots.MOTION_WINDOW_S, plots.control_stamp_ns)
        second = instruments.add_tab("Timing", viser.Icon.CLOCK)
        effort = plots.PlotGroup(server, second, plots.EFFORT, plots.MOTION_WINDOW_S, plots.control_stamp_ns)
        timing = plots.PlotGroup(server, second, plots.TIMING, plots.TIMING_WINDOW_S, plots.health_stamp_ns)
        self.plots = (motion, effort, timing)
        instruments.dock_left()
        instruments.set_width(340)

    @property
    def options(self) -> ViewOptions:
        """What the viewer asked to see."""
        return ViewOptions(
            rejected=self._rejected.value,
            world=self._world.value,
            trails=self._trails.value,
            truth=self._truth.value,
            frustum=self._frustum.value,
            detections=self._detections.value,
        )

    @property
    def camera_mode(self) -> CameraMode:
        """How the viewer's camera moves."""
        return self._camera.value

    def show(self, k: int) -> None:
        """Asks for the k-th vehicle in full, from any thread; it is shown from the next ``settle`` on."""
        self._wanted = k

    def settle(self) -> None:
        """Changes the vehicle shown if another was asked for. Only who also draws may call it."""
        wanted = self._wanted
        if wanted == self.shown:
            return
        self.shown = wanted
        for group in self.plots:
            group.clear()
        self._on_select()

    def update(self, snaps: Sequence[Snapshot]) -> None:
        """Shows the snapshots' words, one a vehicle; cheap to call often, unchanged text is not sent."""
        snap = snaps[self.shown]
        self._overlay.content = overlay.overlay_html(snap, self._alerts(snaps), fleet=len(snaps) > 1)
        if self._fleet is not None:
            self._fleet.content = fleet_html.fleet_html(snaps, snap.vehicle)
        self._status.content = html.status_html(snap)
        self.commands.update(snap)
        self._command.content = html.command_html(snap)
        self._readiness.content = html.readiness_html(snap)
        self._link.content = link_html.link_html(snap)
        self._radio_folder.visible = snap.autopilot is not None
        self._radio.content = link_html.radio_html(snap)
        self._vehicle.content = html.vehicle_html(snap)
        self._events.content = html.events_html(snap)
        fresh = snap.fresh("plan", PLAN_STALE_S)
        self._picture.content = candidates_html.picture_html(snap, fresh=fresh)
        self._strip.content = candidates_html.strip_html(snap, fresh=fresh)

    def _alerts(self, snaps: Sequence[Snapshot]) -> list[tuple[str, Alert]]:
        """Of all vehicles, the severe first, each with its vehicle's name if there are several."""
        found = [
            (snap.vehicle if len(snaps) > 1 else "", alert)
            for snap, board in zip(snaps, self._boards, strict=True)
            for alert in board.update(snap)
        ]
        found.sort(key=lambda pair: (pair[1].over, not pair[1].severe))
        if len(found) > MAX_ALERTS:
            more = Alert(key="more", severe=False, text=f"and {len(found) - MAX_ALERTS} more")
            return [*found[:MAX_ALERTS], ("", more)]
        return found
