"""Start and Stop: what they do, the question before a start, and the second press before all are stopped."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import viser

from goshawk_dashboards.live.feed import Feed
from goshawk_dashboards.page.status import failing_checks
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.state import protocol
from goshawk_dashboards.state.snapshot import Snapshot

DEFAULT_PROFILE = "default profile"
GREEN, AMBER = (38, 150, 92), (205, 140, 30)
STOP_ALL_WITHIN_S = 4.0
"""The second press that stops all must come this soon after the first."""


class Commands:
    """One viewer's commands: those of the vehicle that is ``shown()``, and Stop for all where there are several."""

    def __init__(
        self, viewer: Viewer, feeds: Sequence[Feed], *, shown: Callable[[], Feed], on_armed: Callable[[], None]
    ) -> None:
        """``on_armed``: Stop all was pressed once, which is to be seen at once."""
        self._viewer = viewer
        self._feeds = feeds
        self._shown = shown
        self._on_armed = on_armed
        self._armed_until_s = 0.0
        gui = viewer.gui
        choices = tuple[str, ...]((DEFAULT_PROFILE,))
        self._profile = gui.add_dropdown("Profile", choices, initial_value=DEFAULT_PROFILE)
        self._start = gui.add_button("Start", color=GREEN, icon=viser.Icon.PLAYER_PLAY, hint="Asks before it starts")
        self._start.on_click(lambda _: self._ask_start())
        # The buttons are the overlay's; they and the keys come as these commands.
        key = gui.add_command("Stop", description="The vehicle shown brakes and lands", hotkey="space")
        key.on_trigger(lambda _: self._stop())
        key = gui.add_command(
            "Cancel Stop",
            description="A Stop of the vehicle shown that is not confirmed is taken back",
            hotkey="backspace",
            modifier="alt+shift",
        )
        key.on_trigger(lambda _: self._cancel())
        if len(feeds) > 1:
            key = gui.add_command(
                "Stop all", description="Twice: every vehicle lands", hotkey="space", modifier="shift"
            )
            key.on_trigger(lambda _: self._stop_all())

    @property
    def armed(self) -> bool:
        """Whether one more press stops all."""
        return time.monotonic() < self._armed_until_s

    @property
    def offers_start(self) -> bool:
        """Whether there is a Start to press."""
        return self._start.visible

    def _stop(self) -> None:
        self._shown().vehicle.on_stop()

    def _cancel(self) -> None:
        self._shown().vehicle.on_cancel()

    def _stop_all(self) -> None:
        if self.armed:
            self._armed_until_s = 0.0
            for feed in self._feeds:
                feed.vehicle.on_stop()
        else:
            self._armed_until_s = time.monotonic() + STOP_ALL_WITHIN_S
        self._on_armed()

    def update(self, snap: Snapshot) -> None:
        """Offers Start with the profiles of the vehicle shown, unless it flies or only Stop works."""
        self._start.visible = self._profile.visible = not snap.flying and not protocol.mismatch(snap.health)
        if snap.health is None:
            return
        profiles = (DEFAULT_PROFILE, *snap.health.profiles)
        if self._profile.options != profiles:
            kept = self._profile.value if self._profile.value in profiles else DEFAULT_PROFILE
            self._profile.options = profiles
            self._profile.value = kept

    def _ask_start(self) -> None:
        # What is asked about is what is started, whatever is shown by the time of the answer.
        vehicle = self._shown().vehicle
        profile = "" if self._profile.value == DEFAULT_PROFILE else self._profile.value
        snap = vehicle.latest()
        failing = failing_checks(snap)
        heard = snap.health is not None and not snap.stale
        gui = self._viewer.gui
        modal = gui.add_modal(f"Start {vehicle.name}?" if heard else f"{vehicle.name} cannot be started")
        with modal:
            if failing:
                gui.add_markdown("**Not ready:**\n\n" + "\n".join(f"- {_plain(line)}" for line in failing))
            else:
                gui.add_markdown(
                    f"Every check passes. **{_plain(vehicle.name)}** will arm and take off"
                    f" with {'its default profile' if not profile else f'profile **{_plain(profile)}**'}."
                )
            if heard:
                go = gui.add_button(
                    "Start anyway" if failing else "Start now",
                    color=AMBER if failing else GREEN,
                    icon=viser.Icon.PLAYER_PLAY,
                )

                @go.on_click
                def _(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
                    modal.close()
                    vehicle.on_start(profile)

            gui.add_button("Cancel" if heard else "Close", color="gray").on_click(lambda _: modal.close())


def _plain(text: str) -> str:
    """Text from outside as Markdown that means nothing but itself."""
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>()#+-!|&" else c for c in text.replace("\n", " "))
