"""Start and Stop: what they do, and the question before a start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import viser

from goshawk_dashboards import overlay
from goshawk_dashboards import panels_html as html
from goshawk_dashboards.snapshot import CommandView, Snapshot

DEFAULT_PROFILE = "default profile"
GREEN, AMBER = (38, 150, 92), (205, 140, 30)


@dataclass(frozen=True, kw_only=True)
class Watched:
    """One vehicle as the dashboard needs it. ``latest`` is quick and safe from any thread; the others may block."""

    name: str
    latest: Callable[[], Snapshot]
    on_start: Callable[[str], CommandView]
    """Takes a start profile; empty: the vehicle's default."""
    on_stop: Callable[[], CommandView]


class Commands:
    """The commands of the vehicle that is ``shown()``, and Stop for all where there are several."""

    def __init__(self, server: viser.ViserServer, vehicles: Sequence[Watched], *, shown: Callable[[], int]) -> None:
        self._server = server
        self._vehicles = vehicles
        self._shown = shown
        # A reply may take seconds; Stop for all must not wait for one vehicle after the other.
        self._stopping = ThreadPoolExecutor(max_workers=max(1, len(vehicles)), thread_name_prefix="stop")
        gui = server.gui
        choices = tuple[str, ...]((DEFAULT_PROFILE,))
        self._profile = gui.add_dropdown("Profile", choices, initial_value=DEFAULT_PROFILE)
        start = gui.add_button("Start", color=GREEN, icon=viser.Icon.PLAYER_PLAY, hint="Asks before it starts")
        start.on_click(self._ask_start)
        # The stop buttons are the overlay's; they and the keys come as these commands.
        gui.add_html(overlay.frame_html())
        key = gui.add_command("Stop", description="The vehicle shown brakes and lands", hotkey="space")
        key.on_trigger(lambda _: self._stop_shown())
        if len(vehicles) > 1:
            key = gui.add_command("Stop all", description="Every vehicle lands", hotkey="space", modifier="shift")
            key.on_trigger(lambda _: self.stop_all())

    def _stop_shown(self) -> None:
        self._vehicles[self._shown()].on_stop()

    def stop_all(self) -> None:
        """Every vehicle brakes and lands, all asked at once."""
        for vehicle in self._vehicles:
            self._stopping.submit(vehicle.on_stop)

    def update(self, snap: Snapshot) -> None:
        """Offers the start profiles of the vehicle shown."""
        if snap.health is None:
            return
        profiles = (DEFAULT_PROFILE, *snap.health.profiles)
        if self._profile.options != profiles:
            kept = self._profile.value if self._profile.value in profiles else DEFAULT_PROFILE
            self._profile.options = profiles
            self._profile.value = kept

    def close(self) -> None:
        """Waits for no reply."""
        self._stopping.shutdown(wait=False, cancel_futures=True)

    def _ask_start(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        gui = event.client.gui if event.client is not None else self._server.gui
        # What is asked about is what is started, whatever is shown by the time of the answer.
        vehicle = self._vehicles[self._shown()]
        profile = "" if self._profile.value == DEFAULT_PROFILE else self._profile.value
        failing = html.failing_checks(vehicle.latest())
        modal = gui.add_modal(f"Start {vehicle.name}?")
        with modal:
            if failing:
                gui.add_markdown("**Not ready:**\n\n" + "\n".join(f"- {_plain(line)}" for line in failing))
            else:
                gui.add_markdown(
                    f"Every check passes. **{_plain(vehicle.name)}** will arm and take off"
                    f" with {'its default profile' if not profile else f'profile **{_plain(profile)}**'}."
                )
            go = gui.add_button(
                "Start anyway" if failing else "Start now",
                color=AMBER if failing else GREEN,
                icon=viser.Icon.PLAYER_PLAY,
            )
            cancel = gui.add_button("Cancel", color="gray")

        @go.on_click
        def _(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            modal.close()
            vehicle.on_start(profile)

        @cancel.on_click
        def _(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            modal.close()


def _plain(text: str) -> str:
    """Text from outside as Markdown that means nothing but itself."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>()#+-!|&" else c for c in text.replace("\n", " "))
