"""The demo begins when somebody looks: it opens a browser on a desktop, and waits a little for one anywhere."""

from __future__ import annotations

import os
import sys
import threading
import time
import webbrowser

from goshawk_dashboards.live.dashboard import LiveDashboard
from rich.console import Console

WAIT_S = 30.0
"""Then it flies for nobody: the dashboard can be opened late, too."""


def on_desktop() -> bool:
    """Whether a browser that is opened here is seen by whoever started this."""
    return sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def await_browser(dashboard: LiveDashboard, console: Console, ended: threading.Event, wait_s: float = WAIT_S) -> bool:
    """Whether one came in time, and before somebody ended it all."""
    if on_desktop():
        webbrowser.open(dashboard.url)
    until_s = time.monotonic() + wait_s
    with console.status(f"open the dashboard to see the flight; it begins without you in {wait_s:.0f} s"):
        while not dashboard.views and time.monotonic() < until_s and not ended.wait(0.1):
            pass
    return bool(dashboard.views)
