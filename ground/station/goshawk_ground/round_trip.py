"""How long a question takes to the vehicle's own process and back, asked once a second.

The question is Zenoh's own, for the vehicle's liveliness token: the vehicle's session answers it, so no code on board
takes part, no message of ours exists for it, and it is a few bytes. It is asked like any other traffic, so it is as
late as that is.
"""

from __future__ import annotations

import contextlib
import time

import zenoh

PERIOD_S = 1.0
TIMEOUT_S = 1.0


def measure_s(session: zenoh.Session, token_key: str) -> float | None:
    """Seconds until the vehicle's token came back; None if it did not within ``TIMEOUT_S``."""
    asked_s = time.monotonic()
    with contextlib.suppress(zenoh.ZError):
        for reply in session.liveliness().get(token_key, timeout=TIMEOUT_S):
            if reply.ok is not None:
                return time.monotonic() - asked_s
    return None
