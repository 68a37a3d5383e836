"""A TCP proxy on loopback that can hold everything up for a while and then let it through."""

import contextlib
import socket
import threading


class StallingProxy:
    """Passes bytes between whoever connects and a port on loopback; a context manager."""

    def __init__(self, upstream_port: int) -> None:
        self._upstream = upstream_port
        self._flowing = threading.Event()
        self._flowing.set()
        self._sockets: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> "StallingProxy":
        return self

    def __exit__(self, *_error: object) -> None:
        self._flowing.set()
        # Closing alone would leave the threads in recv and accept.
        for each in (self._server, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def stall(self) -> None:
        """Let nothing through; nothing is lost either."""
        self._flowing.clear()

    def resume(self) -> None:
        """Let through what was held up, and what comes."""
        self._flowing.set()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._server.accept()
                try:
                    far = socket.create_connection(("127.0.0.1", self._upstream))
                except OSError:
                    near.close()
                    continue
                self._sockets += [near, far]
                for a, b in ((near, far), (far, near)):
                    threading.Thread(target=self._pump, args=(a, b), daemon=True).start()

    def _pump(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                self._flowing.wait()
                sink.sendall(data)
        for each in (source, sink):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
