"""Decides what the demo does next: wait, start, stop, or end. Pure: time and facts are arguments."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from goshawk_dashboards.state import words
from goshawk_proto import goshawk_pb2 as pb

from goshawk_ground.demo.flight_record import DOWN, NAVIGATING, TRACKING

STOPPED = "it was stopped"
"""The failure of a flight that somebody ended."""
ON_TASK = {*TRACKING, *NAVIGATING}
FLYING = {pb.MODE_TAKEOFF, *ON_TASK}


class Action(enum.Enum):
    """What the demo should do now."""

    WAIT = "wait"
    START = "start"
    STOP = "stop"
    END = "end"


class Phase(enum.Enum):
    """Where the demo is."""

    WAITING_READY = "waiting until ready"
    TAKING_OFF = "taking off"
    UNDER_WAY = "under way"
    LANDING = "landing"
    ENDED = "ended"


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The most seconds each phase may take."""

    ready_s: float = 60.0
    takeoff_s: float = 30.0
    chase_s: float
    landing_s: float = 45.0


class Director:
    """Call ``step`` often; it returns each of START and STOP at most once. A failed phase stops the flight."""

    def __init__(self, limits: Limits, now_s: float, phase: Phase = Phase.WAITING_READY) -> None:
        """``phase`` is TAKING_OFF for a flight that somebody else has started."""
        self._limits = limits
        self._since_s = now_s
        self.phase = phase
        self.failure: str | None = None
        """Why the flight was cut short; None while all is well."""

    def step(
        self,
        now_s: float,
        *,
        mode: pb.Mode | None,
        ready: bool,
        arrived: bool,
        collided: bool,
        stopped: bool = False,
        why_not_ready: str = "",
    ) -> Action:
        """The next action. ``mode`` None: the vehicle is not heard (yet); ``stopped``: somebody has pressed Stop."""
        late_s = now_s - self._since_s
        word = "unknown" if mode is None else words.mode(mode)
        if self.phase is Phase.WAITING_READY:
            if ready and mode == pb.MODE_READY:
                return self._enter(Phase.TAKING_OFF, now_s, Action.START)
            if late_s > self._limits.ready_s:
                self.failure = f"not ready after {self._limits.ready_s:.0f} s: {why_not_ready or 'no heartbeat'}"
                return self._enter(Phase.ENDED, now_s, Action.END)
        elif stopped and self.phase in (Phase.TAKING_OFF, Phase.UNDER_WAY) and not arrived:
            self.failure = STOPPED
            return self._enter(Phase.LANDING, now_s, Action.WAIT)
        elif self.phase is Phase.TAKING_OFF:
            if mode in ON_TASK:
                self._enter(Phase.UNDER_WAY, now_s, Action.WAIT)
            elif mode == pb.MODE_FAULT:
                return self._abort(now_s, "the vehicle reported a fault at takeoff")
            elif late_s > self._limits.takeoff_s:
                return self._abort(now_s, f"not under way {self._limits.takeoff_s:.0f} s after start (mode {word})")
        elif self.phase is Phase.UNDER_WAY:
            if arrived:
                return self._enter(Phase.LANDING, now_s, Action.STOP)
            if collided:
                return self._abort(now_s, "collision")
            if mode not in FLYING:
                return self._abort(now_s, f"the flight ended by itself (mode {word})")
            if late_s > self._limits.chase_s:
                return self._abort(now_s, f"nobody arrived within {self._limits.chase_s:.0f} s")
        elif self.phase is Phase.LANDING:
            if mode in DOWN:
                return self._enter(Phase.ENDED, now_s, Action.END)
            if late_s > self._limits.landing_s:
                self.failure = self.failure or f"not landed {self._limits.landing_s:.0f} s after stop (mode {word})"
                return self._enter(Phase.ENDED, now_s, Action.END)
        return Action.WAIT if self.phase is not Phase.ENDED else Action.END

    def refused(self, now_s: float, reason: str) -> None:
        """The vehicle did not take START."""
        self.failure = f"start was not accepted: {reason}"
        self._enter(Phase.ENDED, now_s, Action.END)

    def _abort(self, now_s: float, why: str) -> Action:
        self.failure = why
        return self._enter(Phase.LANDING, now_s, Action.STOP)

    def _enter(self, phase: Phase, now_s: float, action: Action) -> Action:
        self.phase = phase
        self._since_s = now_s
        return action
