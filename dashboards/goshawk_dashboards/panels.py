"""The panels beside the 3-D view: status, commands, readiness, link, vehicle, events, view options, picture, plots."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from goshawk_dashboards import panels_html as html
from goshawk_dashboards import theme
from goshawk_dashboards.cameras import CameraMode
from goshawk_dashboards.plots import LivePlots
from goshawk_dashboards.scene import ViewOptions, decode_preview
from goshawk_dashboards.snapshot import CommandView, Snapshot

DEFAULT_PROFILE = "default profile"


class LivePanels:
    """Shows snapshots in a viser server's GUI; Start and Stop call what they were given."""

    def __init__(
        self,
        server: viser.ViserServer,
        *,
        on_start: Callable[[str], CommandView],
        on_stop: Callable[[], CommandView],
        latest: Callable[[], Snapshot],
        on_clear: Callable[[], None],
    ) -> None:
        self._server = server
        self._on_start = on_start
        self._on_stop = on_stop
        self._latest = latest
        gui = server.gui
        self._status = gui.add_html("")
        choices = tuple[str, ...]((DEFAULT_PROFILE,))
        self._profile = gui.add_dropdown("Profile", choices, initial_value=DEFAULT_PROFILE)
        start = gui.add_button("Start", color=(38, 150, 92), icon=viser.Icon.PLAYER_PLAY, hint="Asks before it starts")
        stop = gui.add_button("Stop", color=(205, 52, 66), icon=viser.Icon.PLAYER_STOP, hint="At once, no question")
        start.on_click(self._ask_start)

        @stop.on_click
        def _(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            self._on_stop()

        self._command = gui.add_html("")
        with gui.add_folder("Readiness"):
            self._readiness = gui.add_html("")
        with gui.add_folder("Link"):
            self._link = gui.add_html("")
        with gui.add_folder("Events"):
            self._events = gui.add_html("")
        with gui.add_folder("Vehicle", expand_by_default=False):
            self._vehicle = gui.add_html("")
        with gui.add_folder("View", expand_by_default=False):
            self._camera = gui.add_dropdown("Camera", ("Follow", "Chase", "Free"), initial_value="Follow")
            self._rejected = gui.add_checkbox("Rejected candidates", True)
            self._trails = gui.add_checkbox("Trails", True)
            self._frustum = gui.add_checkbox("Camera frustum", True)
            self._world = gui.add_checkbox("World (simulator)", True)
            self._truth = gui.add_checkbox("True target (simulator)", True)
            gui.add_button("Clear trails").on_click(lambda _: on_clear())
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        instruments = gui.add_panel()
        with instruments.add_tab("Instruments", viser.Icon.CHART_LINE):
            self._picture = gui.add_image(np.full((192, 320, 3), theme.BACKGROUND, dtype=np.uint8))
            gui.add_html(_legend_html())
            self.plots = LivePlots(server)
        instruments.dock_left()
        instruments.set_width(340)
        self._preview_seq: int | None = None

    @property
    def options(self) -> ViewOptions:
        """What the viewer asked to see."""
        return ViewOptions(
            rejected=self._rejected.value,
            world=self._world.value,
            trails=self._trails.value,
            truth=self._truth.value,
            frustum=self._frustum.value,
        )

    @property
    def camera_mode(self) -> CameraMode:
        """How the viewer's camera moves."""
        return self._camera.value

    def update(self, snap: Snapshot) -> None:
        """Shows one snapshot's words; cheap to call often, unchanged text is not sent."""
        self._status.content = html.status_html(snap)
        self._command.content = html.command_html(snap)
        self._readiness.content = html.readiness_html(snap)
        self._link.content = html.link_html(snap)
        self._vehicle.content = html.vehicle_html(snap)
        self._events.content = html.events_html(snap)
        if snap.health is not None:
            profiles = (DEFAULT_PROFILE, *snap.health.profiles)
            if self._profile.options != profiles:
                kept = self._profile.value if self._profile.value in profiles else DEFAULT_PROFILE
                self._profile.options = profiles
                self._profile.value = kept
        if snap.preview is not None and snap.preview.seq != self._preview_seq:
            self._preview_seq = snap.preview.seq
            picture = decode_preview(snap.preview)
            if picture is not None:
                self._picture.image = enlarged(picture)

    def _ask_start(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        gui = event.client.gui if event.client is not None else self._server.gui
        profile = "" if self._profile.value == DEFAULT_PROFILE else self._profile.value
        failing = html.failing_checks(self._latest())
        modal = gui.add_modal("Start the flight?")
        with modal:
            if failing:
                gui.add_markdown("**Not ready:**\n\n" + "\n".join(f"- {_plain(line)}" for line in failing))
            else:
                gui.add_markdown("Every check passes. The vehicle will arm and take off.")
            go = gui.add_button(
                "Start anyway" if failing else "Start now",
                color=(205, 140, 30) if failing else (38, 150, 92),
                icon=viser.Icon.PLAYER_PLAY,
            )
            cancel = gui.add_button("Cancel", color="gray")

        @go.on_click
        def _(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            modal.close()
            self._on_start(profile)

        @cancel.on_click
        def _(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            modal.close()


def enlarged(picture: np.ndarray, width: int = 320) -> np.ndarray:
    """A small picture with each pixel repeated to about ``width``: what the network sees, not smoothed."""
    times = max(1, width // picture.shape[1])
    return picture.repeat(times, axis=0).repeat(times, axis=1)


def _plain(text: str) -> str:
    """Text from outside as Markdown that means nothing but itself."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>()#+-!|&" else c for c in text.replace("\n", " "))


def _legend_html() -> str:
    items = (
        ("desired", theme.GOOD),
        ("attitude", theme.VEHICLE),
        ("disturbance", theme.DISTURBANCE),
        ("measured", (205, 211, 220)),
    )
    return (
        '<div style="font:11px system-ui;color:#aab3c0;padding:2px 8px;display:flex;flex-wrap:wrap;gap:2px 9px">'
        + "".join(
            f'<span><span style="display:inline-block;width:10px;height:3px;border-radius:2px;vertical-align:middle;'
            f'background:{theme.css(c)}"></span> {name}</span>'
            for name, c in items
        )
        + "</div>"
    )
