"""What a person is told when the vehicle does not answer. Pure: from a snapshot."""

from __future__ import annotations

from goshawk_dashboards.state.snapshot import Snapshot


def why_silent(snap: Snapshot, waited_s: float) -> str:
    """One line: what to check when the vehicle did not answer within ``waited_s``."""
    if not snap.linked:
        return (
            f"no vehicle at {snap.endpoint} within {waited_s:g} s: check that goshawk-air runs and that --connect "
            "is an endpoint it listens on"
        )
    if not snap.alive:
        return (
            f"{snap.endpoint} is up, but no vehicle named '{snap.vehicle}' answered within {waited_s:g} s: check "
            "--vehicle against its vehicle file, and with keys that it admits you (`goshawk keys list`)"
        )
    return (
        f"'{snap.vehicle}' is alive but did not answer within {waited_s:g} s: the link may be too weak; it may still "
        "act, watch its mode"
    )


def why_undelivered(snap: Snapshot) -> str:
    """What to do now that a Stop is not confirmed, then why it is not: read in a hurry, so no command line is in it."""
    if not snap.linked:
        return f"Stop not delivered. Pilot: take over. There is no link to {snap.endpoint}."
    if not snap.alive:
        return (
            f"Stop not delivered. Pilot: take over. {snap.endpoint} answers, but no vehicle named '{snap.vehicle}' "
            "is there."
        )
    return f"Stop not confirmed. Pilot: take over. '{snap.vehicle}' is there and does not answer; it may still act."
