"""A second host behind a radio that really loses and delays packets: a network namespace and a pair of TUN devices.

Kernels without netem know no loss; here a thread of the test carries each packet from one device to the other, late, or
not at all. Needs root and the command `ip`.
"""

from __future__ import annotations

import fcntl
import heapq
import os
import random
import shutil
import struct
import subprocess
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

NEAR = "10.213.8.1"
"""This host's address on the radio."""
FAR = "10.213.8.2"
TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000


def missing() -> str | None:
    """Why there can be no such host here; None: there can."""
    if os.geteuid() != 0 or shutil.which("ip") is None or not Path("/dev/net/tun").exists():
        return "needs root, the command `ip` and /dev/net/tun"
    return None


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


def _tun(name: str) -> int:
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
    return device


@dataclass(kw_only=True)
class LossyNet:
    """The far host; `before` runs a command there. ``cut`` loses all."""

    loss: float
    """Share of packets lost, each way."""
    delay_s: float
    """One way."""
    seed: int = 1
    lost: int = 0
    carried: int = 0
    _closing: threading.Event = field(default_factory=threading.Event)
    _cut: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Self:
        tag = os.getpid() % 100_000
        self._space, near, far = f"goshawk-far-{tag}", f"gn{tag}", f"gf{tag}"
        _ip("netns", "add", self._space)
        self._devices = (_tun(near), _tun(far))
        _ip("link", "set", far, "netns", self._space)
        for where, name, address, peer in (((), near, NEAR, FAR), (("-n", self._space), far, FAR, NEAR)):
            _ip(*where, "addr", "add", address, "peer", peer, "dev", name)
            _ip(*where, "link", "set", name, "up")
        _ip("-n", self._space, "link", "set", "lo", "up")
        self._threads = [
            threading.Thread(target=self._carry, args=(source, sink, self.seed + k), daemon=True)
            for k, (source, sink) in enumerate((self._devices, self._devices[::-1]))
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join(timeout=2.0)
        for device in self._devices:
            os.close(device)
        _ip("netns", "del", self._space)

    @property
    def before(self) -> list[str]:
        return ["ip", "netns", "exec", self._space]

    def cut(self) -> None:
        self._cut.set()

    def mend(self) -> None:
        self._cut.clear()

    def _carry(self, source: int, sink: int, seed: int) -> None:
        chance = random.Random(seed)
        under_way: list[tuple[float, int, bytes]] = []
        count = 0
        while not self._closing.is_set():
            now = time.monotonic()
            while under_way and under_way[0][0] <= now:
                try:
                    os.write(sink, heapq.heappop(under_way)[2])
                except OSError:
                    self.lost += 1  # the device's queue is full, as a radio's may be
            try:
                packet = os.read(source, 65536)
            except BlockingIOError:
                time.sleep(0.0005)
                continue
            if self._cut.is_set() or chance.random() < self.loss:
                self.lost += 1
                continue
            self.carried += 1
            count += 1
            heapq.heappush(under_way, (now + self.delay_s, count, packet))
