"""How long a question takes to the vehicle's process and back, asked once a second.

The question and its answer are empty and as urgent as plans, behind which they wait: so what is seen is about as late
as they are. (Zenoh's question for a liveliness token would not do: once a token is subscribed to, the asker's own
session answers it.)
"""

from __future__ import annotations

import contextlib
import math
import time

import zenoh
from goshawk_proto import KEYS, key_expression

PERIOD_S = 1.0
TIMEOUT_S = 2.0
"""A later answer is not waited for."""


def measure_s(session: zenoh.Session, vehicle: str, timeout_s: float = TIMEOUT_S) -> float:
    """Seconds until the vehicle's answer came back; infinite if it did not within ``timeout_s``."""
    row = KEYS["ping"]
    asked_s = time.monotonic()
    with contextlib.suppress(zenoh.ZError):
        replies = session.get(
            key_expression("ping", vehicle),
            timeout=timeout_s,
            priority=row.priority,
            congestion_control=row.congestion,
            express=row.express,
        )
        for reply in replies:
            if reply.ok is not None:
                return time.monotonic() - asked_s
    return math.inf
