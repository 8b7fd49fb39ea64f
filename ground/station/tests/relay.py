"""A TCP relay between a ground and its vehicle, to cut or to stall the link."""

from __future__ import annotations

import contextlib
import select
import socket
import threading


class Relay:
    """Passes bytes both ways while ``flowing``; ``stall`` keeps connections open and silent, ``cut`` closes them."""

    def __init__(self, endpoint: str) -> None:
        """``endpoint``: where the vehicle listens, such as tcp/127.0.0.1:7447."""
        host, port = endpoint.removeprefix("tcp/").split(":")
        self._to = (host, int(port))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._flowing, self._accepting = threading.Event(), threading.Event()
        self._flowing.set()
        self._accepting.set()
        self._closing = threading.Event()
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def stall(self) -> None:
        """Nothing passes any more, and nobody is told."""
        self._flowing.clear()

    def cut(self) -> None:
        """Every connection ends, and a new one ends at once."""
        self._accepting.clear()
        for pair in self._pairs:
            for end in pair:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        """All passes again."""
        self._accepting.set()
        self._flowing.set()

    def close(self) -> None:
        """Ends for good."""
        self._closing.set()
        self.cut()
        self._thread.join()
        self._listener.close()

    def _accept(self) -> None:
        while not self._closing.is_set():
            if not select.select([self._listener], [], [], 0.1)[0]:
                continue
            try:
                near, _ = self._listener.accept()
                if not self._accepting.is_set():
                    near.close()
                    continue
                far = socket.create_connection(self._to, timeout=2.0)
            except OSError:
                continue
            self._pairs.append((near, far))
            for here, there in ((near, far), (far, near)):
                threading.Thread(target=self._pass, args=(here, there), daemon=True).start()

    def _pass(self, here: socket.socket, there: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := here.recv(65536):
                while not self._flowing.wait(0.1):
                    if self._closing.is_set():
                        return
                there.sendall(data)
        for end in (here, there):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
