"""The panels beside the 3-D view: status, commands, readiness, links, events, view options; picture and plots."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence

import viser

from goshawk_dashboards.live import overlay, plots
from goshawk_dashboards.live.commands import Commands
from goshawk_dashboards.live.feed import Feed, worst_alerts
from goshawk_dashboards.live.fleet import fleet_html
from goshawk_dashboards.live.phone import phone_html
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.scene.cameras import CameraMode
from goshawk_dashboards.scene.scene import ViewOptions
from goshawk_dashboards.state.snapshot import Snapshot

SHOW_KEYS = ("1", "2", "3", "4", "5", "6", "7", "8", "9")


class LivePanels:
    """The panels of one viewer, who chooses which vehicle they show in full."""

    def __init__(
        self,
        viewer: Viewer,
        feeds: Sequence[Feed],
        *,
        commands: bool,
        on_select: Callable[[], None],
        on_clear: Callable[[], None],
        on_armed: Callable[[], None],
        narrow: Callable[[], bool] = lambda: False,
    ) -> None:
        """``commands``: with the buttons and keys that command; without them the viewer only looks.

        ``on_select``: another vehicle is shown; ``on_clear``: the trails are to be forgotten; ``on_armed``: what the
        stop buttons say has changed; ``narrow``: whether the window is a phone's.
        """
        self._viewer = viewer
        self._feeds = feeds
        self._on_select = on_select
        self._narrow = narrow
        self.shown = 0
        """Index of the vehicle shown in full."""
        self._wanted = 0
        self._visit = uuid.uuid4().hex
        """Tells the page that it is connected anew, here or to a ground station that was started again."""
        gui = viewer.gui
        self._overlay = gui.add_html("")
        self._phone = gui.add_html("")
        self._fleet = self._make_fleet(commands) if len(feeds) > 1 else None
        self._status = gui.add_html("")
        self.commands = (
            Commands(viewer, feeds, shown=lambda: feeds[self.shown], on_armed=on_armed) if commands else None
        )
        self._command = gui.add_html("")
        self._readiness_folder = gui.add_folder("Readiness")
        with self._readiness_folder:
            self._readiness = gui.add_html("")
        with gui.add_folder("Events"):
            self._events = gui.add_html("")
        with gui.add_folder("Link"):
            self._link = gui.add_html("")
        self._radio_folder = gui.add_folder("Autopilot by radio", visible=False)
        with self._radio_folder:
            self._radio = gui.add_html("")
        with gui.add_folder("Vehicle", expand_by_default=False):
            self._vehicle = gui.add_html("")
        self._make_view_options(on_clear)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        self._make_instruments()

    def _make_fleet(self, commands: bool) -> viser.GuiHtmlHandle:
        """A table of all vehicles, and buttons for each; the digits show one too."""
        gui = self._viewer.gui
        table = gui.add_html("")
        with gui.add_folder("Vehicles"):
            for k, feed in enumerate(self._feeds):
                group = gui.add_button_group(feed.vehicle.name, ("Show", "Stop") if commands else ("Show",))

                @group.on_click
                def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle], k: int = k) -> None:
                    if event.target.value == "Show":
                        self.show(k)
                    else:
                        self._feeds[k].vehicle.on_stop()

        for k, (digit, feed) in enumerate(zip(SHOW_KEYS, self._feeds, strict=False)):
            key = gui.add_command(f"Show {feed.vehicle.name}", hotkey=digit)
            key.on_trigger(lambda _, k=k: self.show(k))
        return table

    def _make_view_options(self, on_clear: Callable[[], None]) -> None:
        gui = self._viewer.gui
        with gui.add_folder("View", expand_by_default=False):
            self._camera = gui.add_dropdown("Camera", ("Follow", "Chase", "Free"), initial_value="Follow")
            self._rejected = gui.add_checkbox("Rejected candidates", True)
            self._detections = gui.add_checkbox("Detections", True)
            self._trails = gui.add_checkbox("Trails", True)
            self._frustum = gui.add_checkbox("Camera frustum", True)
            self._remembered = gui.add_checkbox("Remembered obstacles", True)
            self._depth = gui.add_checkbox("Measured depth", True)
            self._world = gui.add_checkbox("World (simulator)", True)
            self._truth = gui.add_checkbox("True target (simulator)", True)
            gui.add_button("Clear trails").on_click(lambda _: on_clear())

    def _make_instruments(self) -> None:
        gui = self._viewer.gui
        instruments = gui.add_panel()
        with instruments.add_tab("Instruments", viser.Icon.CHART_LINE):
            self._picture = gui.add_html("")
            self._strip = gui.add_html("")
            with gui.add_folder("Candidates", expand_by_default=False):
                self._candidates = gui.add_html("")
            self._estimates = gui.add_html("")
            motion = gui.add_html("")
        with instruments.add_tab("Timing", viser.Icon.CLOCK):
            self._charts = (motion, *(gui.add_html("") for _ in plots.KINDS[1:]))
        instruments.dock_left()
        instruments.set_width(340)

    @property
    def offers_start(self) -> bool:
        """Whether there is a Start to press."""
        return self.commands is not None and self.commands.offers_start

    @property
    def shows_readiness(self) -> bool:
        """Whether the checks are to be seen."""
        return self._readiness_folder.visible

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
            remembered=self._remembered.value,
            depth=self._depth.value,
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
        self._on_select()

    def update_slow(self) -> None:
        """Sends what takes a browser long to draw, and is read at leisure: curves, estimates, tables."""
        words = self._feeds[self.shown].words
        self._link.content = words.link
        self._radio.content = words.radio
        self._vehicle.content = words.vehicle
        self._candidates.content = words.candidates
        self._estimates.content = words.instruments
        for handle, curves in zip(self._charts, self._feeds[self.shown].curves, strict=True):
            handle.content = curves.charts_html()

    def stops(self, snap: Snapshot) -> overlay.Stops:
        """What the buttons over the window say."""
        if self.commands is None:
            return overlay.Stops()
        several = len(self._feeds) > 1
        one = f"Stop {snap.vehicle}" if several else "Stop"
        every = ("Press again: all stop" if self.commands.armed else "Stop all") if several else ""
        cancel = "" if snap.stop is None else "Dismiss" if snap.stop.lapsed else f"Cancel {one}"
        return overlay.Stops(one=one, every=every, armed=self.commands.armed, cancel=cancel)

    def update(self) -> None:
        """Shows the feeds' words; cheap to call often, unchanged text is not sent."""
        feed = self._feeds[self.shown]
        snap, words = feed.snap, feed.words
        self._overlay.content = overlay.overlay_html(
            snap,
            worst_alerts(self._feeds),
            stops=self.stops(snap),
            visit=self._visit,
            vehicles=[f.vehicle.name for f in self._feeds],
        )
        card = phone_html(snap, words.status, words.picture) if self._narrow() else ""
        self._phone.content = overlay.phone_over_html(card)
        if self._fleet is not None:
            self._fleet.content = fleet_html([f.snap for f in self._feeds], snap.vehicle)
        self._status.content = words.status
        if self.commands is not None:
            self.commands.update(snap)
        self._command.content = words.command
        # In the air a failing check is a fault, and an alert says so.
        self._readiness_folder.visible = not snap.flying
        self._readiness.content = words.readiness
        self._radio_folder.visible = snap.autopilot is not None
        self._events.content = words.events
        self._picture.content = words.picture
        self._strip.content = words.strip
