"""What the gate before the dashboard adds to a message's way, against viser without it in the same run.

    python gate.py [--seconds 20]

Two clients see the same viser server at once, one through the gate and one at viser's own socket: a text as of a panel
goes to both 30 times a second, and a cloud of 600 kB. Presses go the other way, in turns. The keys:
`gate_added_down_ms`, `gate_added_up_ms`.
"""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Callable

import msgspec
import numpy as np
import viser
from common import record
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.gate.client import CAMERA, open_page, viser_protocol
from goshawk_dashboards.page.serving import close_server, open_server
from websockets.sync.client import ClientConnection, unix_connect

RATE_HZ = 30.0
CLOUD = 50_000


def main() -> None:
    """Measures and records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="how long each row takes")
    seconds = parser.parse_args().seconds
    gate = Gate(host="127.0.0.1", port=0, access=Access())
    server = open_server(gate, Role.OPERATOR, "bench")
    direct = unix_connect(
        str(gate.folder / f"{Role.OPERATOR}.socket"), subprotocols=[viser_protocol()], max_size=None, compression=None
    )
    gated = open_page(gate.link(Role.OPERATOR))
    cloud = server.scene.add_point_cloud("/cloud", np.zeros((CLOUD, 3)), np.zeros((CLOUD, 3)))
    text, button = server.gui.add_html(""), server.gui.add_button("press")
    print(f"added by the gate, {seconds:.0f} s each{'p50':>12}{'p99':>9}  ms")

    def words(k: int) -> None:
        text.content = f"message {k:06d}" + "x" * 2000

    def points(k: int) -> None:
        cloud.points = np.full((CLOUD, 3), float(k), dtype=np.float32)

    arrivals = {"direct": Arrivals(direct), "gated": Arrivals(gated)}
    p50, p99 = down(server, words, arrivals, seconds)
    print(f"  a text of 2 kB, viser to browser {p50:10.2f}{p99:9.2f}")
    record("gate_added_down_ms", [round(p50, 3), round(p99, 3)])
    p50, p99 = down(server, points, arrivals, seconds)
    print(f"  600 kB of points, viser to browser {p50:8.2f}{p99:9.2f}")
    p50, p99 = up(button, direct, gated, seconds)
    print(f"  a press, browser to viser {p50:17.2f}{p99:9.2f}")
    record("gate_added_up_ms", [round(p50, 3), round(p99, 3)])
    for connection in (direct, gated):
        connection.close()
    close_server(server)
    gate.close()


class Arrivals:
    """When each message of more than 500 bytes came."""

    def __init__(self, connection: ClientConnection) -> None:
        self.at_s: list[float] = []
        self._connection = connection
        connection.send(msgspec.msgpack.encode(CAMERA))
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        for _ in self._connection:
            self.at_s.append(time.perf_counter())


def down(
    server: viser.ViserServer, send: Callable[[int], None], arrivals: dict[str, Arrivals], seconds: float
) -> tuple[float, float]:
    """p50 and p99 of how much later the gated client had a message, ms."""
    time.sleep(1.0)
    late_ms: list[float] = []
    for k in range(int(seconds * RATE_HZ)):
        for each in arrivals.values():
            each.at_s.clear()
        send(k)
        server.flush()
        time.sleep(1.0 / RATE_HZ)
        if all(each.at_s for each in arrivals.values()):
            late_ms.append(1e3 * (arrivals["gated"].at_s[0] - arrivals["direct"].at_s[0]))
    if len(late_ms) < 0.9 * seconds * RATE_HZ:
        raise SystemExit(f"this machine is too busy: {len(late_ms)} of {seconds * RATE_HZ:.0f} messages came in time")
    return float(np.percentile(late_ms, 50)), float(np.percentile(late_ms, 99))


def up(
    button: viser.GuiButtonHandle, direct: ClientConnection, gated: ClientConnection, seconds: float
) -> tuple[float, float]:
    """Differences of p50 and of p99 of a press's way, ms."""
    pressed_s: list[float] = []
    arrived = threading.Event()

    @button.on_click
    def pressed(_: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        pressed_s.append(time.perf_counter())
        arrived.set()

    uuid = button._impl.uuid  # pyright: ignore[reportPrivateUsage] - viser tells it nowhere else
    press = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": True}})
    took_ms: dict[str, list[float]] = {"direct": [], "gated": []}
    for _turn in range(int(seconds * RATE_HZ / 2)):
        for name, connection in (("direct", direct), ("gated", gated)):
            arrived.clear()
            sent_s = time.perf_counter()
            connection.send(press)
            if not arrived.wait(5.0):
                raise SystemExit(f"a press by the {name} way never arrived")
            took_ms[name].append(1e3 * (pressed_s[-1] - sent_s))
            time.sleep(1.0 / RATE_HZ)
    at = {name: np.percentile(values, (50, 99)) for name, values in took_ms.items()}
    return float(at["gated"][0] - at["direct"][0]), float(at["gated"][1] - at["direct"][1])


if __name__ == "__main__":
    main()
