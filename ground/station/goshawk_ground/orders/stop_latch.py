"""Stop, latched: once pressed it is sent under one id until the vehicle confirms it or the operator takes it back.

The vehicle acts on an id once, so sending again costs nothing. A restart of the ground goes on with what is on disk.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from goshawk_dashboards.state.views import CommandView, StopView
from goshawk_proto import goshawk_pb2

from goshawk_ground.orders.ask import Asker, answered, ask_once, sent
from goshawk_ground.orders.stop_file import PendingStop, StopFile

RESUME_S = 600.0
"""A Stop older than this is not taken up by a new ground: whoever pressed it has long found another way, and the flight
that it would end may be another one."""
ATTEMPTS_S = (0.5, 1.0, 2.0, 4.0)
"""How long an answer is waited for before the Stop is sent again, in turn: soon, in case the question was lost; longer,
in case the answer takes its time over a slow link."""
PAUSE_S = 0.05
THREADS = 4
"""Where so many ask, a further press adds none: somebody may hammer the button. A new Stop always gets one."""


class Told(Protocol):
    """Takes each view of the command: pending, then what became of it."""

    def __call__(self, view: CommandView, /) -> None: ...


@dataclass(kw_only=True, eq=False)
class _Pending:
    command_id: str
    at_s: float
    """When it was pressed, by the monotonic clock."""
    resumed: bool = False
    trouble: str = ""


class StopLatch:
    """The Stop of one vehicle. Every method may be called from any thread, and none waits for the vehicle."""

    def __init__(self, link: Asker, told: Told, file: StopFile | None) -> None:
        """``file``: where a pending Stop is kept, and taken up from; None: it ends with this process."""
        self._link, self._told, self._file = link, told, file
        self._lock = threading.Lock()
        self._pending: _Pending | None = None
        self._lapsed: PendingStop | None = None
        self._ended = threading.Condition(self._lock)
        """Signalled when nothing is pending any more."""
        self._pressed = 0
        self._outcome: CommandView | None = None
        self._again = threading.Event()
        self._threads: list[threading.Thread] = []
        kept = None if file is None else file.load()
        if kept is not None:
            self._take_up(kept)

    def _take_up(self, kept: PendingStop) -> None:
        age_s = time.time() - kept.pressed_unix_s
        if abs(age_s) > RESUME_S:
            self._lapsed = kept
            return
        self._pressed += 1
        pressed_s = time.monotonic() - max(age_s, 0.0)
        self._pending = _Pending(command_id=kept.command_id, at_s=pressed_s, resumed=True)
        self._begin(self._pending)

    @property
    def pressed(self) -> int:
        """How often it was pressed; one that was taken up counts."""
        return self._pressed

    @property
    def outcome(self) -> CommandView | None:
        """What became of the last Stop that ended; None: none did."""
        return self._outcome

    def view(self) -> StopView | None:
        """The Stop that is pending, or the one that lapsed."""
        with self._lock:
            pending, lapsed = self._pending, self._lapsed
        if pending is not None:
            return StopView(
                command_id=pending.command_id,
                age_s=time.monotonic() - pending.at_s,
                resumed=pending.resumed,
                trouble=pending.trouble,
            )
        if lapsed is not None:
            age_s = abs(time.time() - lapsed.pressed_unix_s)
            return StopView(command_id=lapsed.command_id, age_s=age_s, resumed=True, lapsed=True)
        return None

    def press(self) -> CommandView:
        """Begins to ask for a stop; one that is pending already is asked at once, under its own id."""
        with self._lock:
            self._pressed += 1
            pending = self._pending
            if pending is None:
                self._lapsed = None
                pending = self._pending = _Pending(command_id=str(uuid.uuid4()), at_s=time.monotonic())
                self._begin(pending)
            elif sum(thread.is_alive() for thread in self._threads) < THREADS:
                # Another question may wait for its answer for seconds.
                self._spawn(self._ask_now, pending)
        self._again.set()
        self._keep(pending)
        return sent("stop", pending.command_id, pending.at_s)

    def cancel(self) -> None:
        """The operator takes it back: it is not asked any more, and a lapsed one is forgotten."""
        with self._lock:
            pending, lapsed = self._pending, self._lapsed
            self._lapsed = None
        if pending is not None:
            text = "cancelled by the operator; the vehicle may have heard it before"
            view = sent("stop", pending.command_id, pending.at_s)
            self._end(pending, replace(view, pending=False, cancelled=True, text=text))
        if lapsed is not None:
            self._forget(lapsed.command_id)

    def give_up(self, why: str) -> None:
        """It is not asked any more, which was not the operator's wish; ``why`` is what they are told."""
        with self._lock:
            pending = self._pending
        if pending is not None:
            self._end(pending, replace(sent("stop", pending.command_id, pending.at_s), pending=False, text=why))

    def wait(self, timeout_s: float) -> bool:
        """Whether nothing is pending any more, at the latest after a time."""
        with self._ended:
            return self._ended.wait_for(lambda: self._pending is None, timeout_s)

    def join(self, timeout_s: float) -> None:
        """Waits for the threads that ask; the link says when they must end."""
        self._again.set()
        for thread in self._threads:
            thread.join(timeout_s)

    # ---- asking ----

    def _begin(self, pending: _Pending) -> None:
        view = sent("stop", pending.command_id, pending.at_s)
        self._told(view)
        if not self._spawn(self._ask, pending):
            self._pending = None
            text = "not sent, for no thread can be started here: press again"
            self._outcome = replace(view, pending=False, text=text)
            self._told(self._outcome)

    def _spawn(self, ask: Callable[[_Pending], None], pending: _Pending) -> bool:
        """Whether a thread that asks is under way."""
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=ask, args=(pending,), name="stop", daemon=True)
        try:
            thread.start()
        except RuntimeError:
            return False
        self._threads.append(thread)
        return True

    def _ask_now(self, pending: _Pending) -> None:
        """Once, beside whoever asks already."""
        if self._link.linked and not self._over(pending):
            request = goshawk_pb2.StopRequest(command_id=pending.command_id)
            self._take(pending, ask_once(self._link, "cmd_stop", request, ATTEMPTS_S[-1]))

    def _take(self, pending: _Pending, reply: goshawk_pb2.CommandReply | None) -> None:
        if reply is not None:
            self._end(pending, answered(sent("stop", pending.command_id, pending.at_s), reply))

    def _ask(self, pending: _Pending) -> None:
        request = goshawk_pb2.StopRequest(command_id=pending.command_id)
        for attempt_s in itertools.cycle(ATTEMPTS_S):
            while not self._link.linked:
                if self._over(pending):
                    return
                self._again.wait(PAUSE_S)
                self._again.clear()
            if self._over(pending):
                return
            self._take(pending, ask_once(self._link, "cmd_stop", request, attempt_s))
            self._again.wait(PAUSE_S)
            self._again.clear()

    def _over(self, pending: _Pending) -> bool:
        return self._link.closing or self._pending is not pending

    def _end(self, pending: _Pending, view: CommandView) -> None:
        with self._ended:
            if self._pending is not pending:
                return
            self._pending, self._outcome = None, view
            self._told(view)
            self._ended.notify_all()
        self._forget(pending.command_id)

    # ---- on disk ----

    def _keep(self, pending: _Pending) -> None:
        """After the first question is under way: a slow disk must not hold it up."""
        if self._file is None:
            return
        pressed_unix_s = time.time() - (time.monotonic() - pending.at_s)
        try:
            self._file.save(PendingStop(command_id=pending.command_id, pressed_unix_s=pressed_unix_s))
            pending.trouble = ""
        except OSError as error:
            pending.trouble = f"{self._file.path} cannot be written, {error.strerror or error}"
        with self._lock:
            kept = self._pending is pending
        if not kept:  # confirmed while it was written
            self._forget(pending.command_id)

    def _forget(self, command_id: str) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.forget(command_id)
