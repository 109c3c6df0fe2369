"""A network link between one process and one router that can be cut or delayed: it carries bytes and knows nothing of them."""

from __future__ import annotations

import contextlib
import queue
import socket
import threading
import time

CHUNK = 65536


class Link:
    """Listens on `endpoint` and carries every connection to the router's. While it is cut, nothing is carried or closed."""

    def __init__(self, router: str) -> None:
        host, _, port = router.removeprefix("tcp/").rpartition(":")
        self._router = host, int(port)
        self._open = threading.Event()
        self._open.set()
        self._delay_s = 0.0
        self._sockets: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Carry nothing, as a cable that is pulled out."""
        self._open.clear()

    def delay(self, by_s: float) -> None:
        """Carry everything so much later."""
        self._delay_s = by_s

    def heal(self) -> None:
        """Carry everything at once; what came meanwhile first, as TCP does."""
        self._delay_s = 0.0
        self._open.set()

    def close(self) -> None:
        """End all connections."""
        self.heal()
        for each in (self._server, *self._sockets):
            # a thread that waits in a socket is woken by its shutdown alone
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._server.accept()
                self._sockets.append(near)
                threading.Thread(target=self._connect, args=(near,), daemon=True).start()

    def _connect(self, near: socket.socket) -> None:
        self._open.wait()
        try:
            far = socket.create_connection(self._router)
        except OSError:  # the router is gone: the process hears it as it would without this link
            near.close()
            return
        self._sockets.append(far)
        for each in (near, far):
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for source, target in ((near, far), (far, near)):
            under_way: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
            threading.Thread(target=self._read, args=(source, under_way), daemon=True).start()
            threading.Thread(target=self._write, args=(target, under_way), daemon=True).start()

    def _read(self, source: socket.socket, under_way: queue.SimpleQueue[tuple[float, bytes]]) -> None:
        data = b"-"
        while data:
            try:
                data = source.recv(CHUNK)
            except OSError:
                data = b""
            under_way.put((time.monotonic(), data))

    def _write(self, target: socket.socket, under_way: queue.SimpleQueue[tuple[float, bytes]]) -> None:
        with contextlib.suppress(OSError):
            while True:
                came_s, data = under_way.get()
                self._open.wait()
                time.sleep(max(0.0, came_s + self._delay_s - time.monotonic()))
                if not data:
                    target.shutdown(socket.SHUT_RDWR)
                    return
                target.sendall(data)
