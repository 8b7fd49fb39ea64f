"""What an operator must not miss, worked out from a snapshot. Pure: the time is the snapshot's."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.state import protocol, words
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import UNSEEN_S

HOLD_S = 5.0
"""An alert whose cause has gone stays this long, said to be over: a blink of trouble is trouble too."""
COMMAND_S = 15.0
"""How long the outcome of a command counts as news."""
RADIO_STALE_S = 3.0
"""The autopilot's heartbeat comes once a second."""
STOP_LATE_S = 1.0
"""A Stop that is not confirmed within this is told about; until then there is nothing to do but wait."""
LOSSY = 0.1
LATE_S = 0.5
"""A round trip over this: what is seen is no longer what is."""
LOW_BATTERY = 0.2


@dataclass(frozen=True, kw_only=True)
class Alert:
    """One thing that is wrong now, or was a moment ago."""

    key: str
    """Names the cause: the same cause is the same alert, however its words change."""
    severe: bool
    """True: the flight is in danger, or a command was not obeyed. False: look soon."""
    text: str
    over: bool = False
    """The cause has gone; it is still shown for a moment."""


def alerts(snap: Snapshot) -> list[Alert]:
    """All that is wrong now, the severe first; empty: nothing is. A vehicle that was never heard is no alert."""
    parts = (_of_stop, _of_command, _of_protocol, _of_link, _of_flight, _of_radio)
    found = [alert for part in parts for alert in part(snap)]
    return sorted(found, key=lambda alert: not alert.severe)


def _of_stop(snap: Snapshot) -> list[Alert]:
    stop = snap.stop
    if stop is None or (not stop.lapsed and stop.age_s < STOP_LATE_S):
        return []
    age = age_words(stop.age_s)
    if stop.lapsed:
        text = f"A Stop pressed {age} ago was never delivered. It has lapsed and is not sent any more."
        return [Alert(key="lapsed", severe=False, text=text)]
    text = f"STOP PENDING for {age}: not delivered. Pilot: take over."
    if stop.trouble:
        text += f" (A restart of the ground station would forget it: {stop.trouble}.)"
    return [Alert(key="stop", severe=True, text=text)]


def age_words(age_s: float) -> str:
    """Seconds, or minutes once there are some."""
    return f"{age_s:.0f} s" if age_s < 120.0 else f"{age_s / 60.0:.0f} min"


def _of_command(snap: Snapshot) -> list[Alert]:
    command = snap.command
    if command is None or command.pending or command.accepted or command.cancelled:
        return []
    if command.at_s is not None and snap.now_s - command.at_s - (command.took_s or 0.0) > COMMAND_S:
        return []
    if command.verb == "stop":
        text = f"Stop refused: {command.text}. Pilot: take over." if command.answered else command.text
        return [Alert(key="command", severe=True, text=text)]
    refused = command.answered or command.refused_here
    verdict = "refused" if refused else "not confirmed"
    return [Alert(key="command", severe=not refused, text=f"{command.verb} {verdict}: {command.text}")]


def _of_protocol(snap: Snapshot) -> list[Alert]:
    text = protocol.mismatch(snap.health)
    return [Alert(key="protocol", severe=False, text=text)] if text else []


def _of_link(snap: Snapshot) -> list[Alert]:
    age_s = snap.heard_age_s
    if age_s is None:
        return []
    if snap.stale:
        mode = "unknown" if snap.mode is None else words.mode(snap.mode)
        doing = f"last heard flying ({mode})" if snap.flying else f"last heard {mode}"
        return [Alert(key="silent", severe=snap.flying, text=f"VEHICLE SILENT for {age_s:.0f} s, {doing}")]
    found: list[Alert] = []
    if not snap.alive:
        found.append(Alert(key="alive", severe=False, text="the vehicle's presence on the network is gone"))
    losses = [c.loss_fraction for c in snap.channels if c.loss_fraction is not None and c.rate_hz > 5.0]
    if losses and max(losses) > LOSSY:
        found.append(Alert(key="loss", severe=False, text=f"weak link: {100 * max(losses):.0f} % of samples lost"))
    if snap.round_trip_s is not None and snap.round_trip_s > LATE_S:
        answers = (
            "no answer for seconds" if math.isinf(snap.round_trip_s) else f"answers take {snap.round_trip_s:.1f} s"
        )
        found.append(Alert(key="late", severe=False, text=f"weak link: {answers}, and what is shown is old"))
    return found


def _of_flight(snap: Snapshot) -> list[Alert]:
    found: list[Alert] = []
    control, health, target = snap.control, snap.health, snap.target
    if snap.mode == pb.MODE_FAULT:
        found.append(Alert(key="fault", severe=True, text="FAULT: authority is handed back to the autopilot"))
    if not snap.flying or snap.stale:
        return found
    # A hand-back is the fault that is told above.
    if control is not None and control.fallback not in (pb.FALLBACK_NONE, pb.FALLBACK_HAND_BACK):
        found.append(Alert(key="fallback", severe=True, text=f"FALLBACK: {words.fallback(control.fallback)}"))
    if health is not None:
        found += [Alert(key=f"fault {k}", severe=True, text=fault) for k, fault in enumerate(health.faults)]
        battery = health.battery_fraction
        if battery is not None and battery < LOW_BATTERY:
            found.append(Alert(key="battery", severe=battery < LOW_BATTERY / 2, text=f"battery {100 * battery:.0f} %"))
    if snap.mode == pb.MODE_SEARCH:
        unseen = (
            f", unseen for {target.since_seen_s:.0f} s" if target is not None and target.since_seen_s > UNSEEN_S else ""
        )
        found.append(Alert(key="search", severe=False, text=f"target lost: searching{unseen}"))
    if snap.truth is not None and snap.truth.collisions and snap.fresh("sim_truth"):
        found.append(Alert(key="collision", severe=True, text=f"COLLISION in the simulator: {snap.truth.collisions}"))
    return found


def _of_radio(snap: Snapshot) -> list[Alert]:
    radio = snap.autopilot
    if radio is None:
        return []
    if radio.trouble:
        return [Alert(key="radio", severe=False, text=f"autopilot's radio: {radio.trouble}")]
    if radio.age_s is None:
        return []
    if radio.age_s > RADIO_STALE_S:
        return [Alert(key="radio", severe=False, text=f"autopilot's radio silent for {radio.age_s:.0f} s")]
    if radio.failsafe:
        return [Alert(key="failsafe", severe=True, text="AUTOPILOT FAILSAFE: its heartbeat says critical")]
    return []


class AlertBoard:
    """Remembers alerts for ``HOLD_S`` after their cause has gone."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[float, Alert]] = {}

    def update(self, snap: Snapshot) -> list[Alert]:
        """What to show now: what is wrong, then what was."""
        now = alerts(snap)
        for alert in now:
            self._last[alert.key] = (snap.now_s, alert)
        self._last = {key: kept for key, kept in self._last.items() if 0.0 <= snap.now_s - kept[0] <= HOLD_S}
        present = {alert.key for alert in now}
        over = [replace(alert, over=True) for key, (_, alert) in self._last.items() if key not in present]
        return now + over
