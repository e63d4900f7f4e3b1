"""A TCP proxy that treats connections badly, in the order that a test asks for."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager

#: What to do with a connection.
#: "pass": nothing. "refuse": close at once. "swallow": hand over the request, then close without the answer.
#: "cut:N": close after N bytes of the answer. "503": answer 503 with `Retry-After: 1`, without the server.
Deed = str

_UNAVAILABLE = (
    b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\ncontent-type: text/plain\r\ncontent-length: 4\r\n"
    b"connection: close\r\n\r\nbusy"
)


class Proxy:
    """Between a client and a server."""

    def __init__(self, port: int, deeds: list[Deed]) -> None:
        self._target = port
        self._deeds = deeds
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        #: Connections so far.
        self.connections = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """No more connections."""
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            deed = self._deeds[self.connections] if self.connections < len(self._deeds) else "pass"
            self.connections += 1
            threading.Thread(target=self._serve, args=(near, deed), daemon=True).start()

    def _serve(self, near: socket.socket, deed: Deed) -> None:
        with _ended(near):
            if deed == "refuse":
                return
            if deed == "503":
                near.recv(65536)
                near.sendall(_UNAVAILABLE)
                return
            with _ended(socket.create_connection(("127.0.0.1", self._target))) as far:
                threading.Thread(target=_pump, args=(near, far), daemon=True).start()
                left = int(deed.removeprefix("cut:")) if deed.startswith("cut:") else None
                try:
                    while chunk := far.recv(4096):
                        if deed == "swallow":
                            return
                        near.sendall(chunk if left is None else chunk[:left])
                        if left is not None:
                            left -= len(chunk)
                            if left <= 0:
                                return
                except OSError:
                    return


@contextmanager
def _ended(connection: socket.socket) -> Iterator[socket.socket]:
    """Closed at the end, also for a thread that reads from it."""
    with closing(connection):
        try:
            yield connection
        finally:
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


def _pump(source: socket.socket, sink: socket.socket) -> None:
    try:
        while chunk := source.recv(4096):
            sink.sendall(chunk)
    except OSError:
        pass


@contextmanager
def proxied(port: int, deeds: list[Deed]) -> Iterator[Proxy]:
    """A proxy for one test."""
    proxy = Proxy(port, deeds)
    try:
        yield proxy
    finally:
        proxy.close()
