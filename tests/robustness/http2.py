"""Frames of HTTP/2 as an attacker writes them (RFC 9113), and a connection that sends them."""
import contextlib
import socket
import struct
import threading
import time

import hpack

DATA, HEADERS, PRIORITY, RST_STREAM, SETTINGS, PING, GOAWAY, WINDOW_UPDATE, CONTINUATION = 0, 1, 2, 3, 4, 6, 7, 8, 9
ACK = END_STREAM = 1
END_HEADERS = 4
PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
STREAM = "/candela.v1.RenderService/Stream"


def frame(kind: int, flags: int, stream: int, payload: bytes = b"") -> bytes:
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def fields(*pairs: tuple[str, str]) -> bytes:
    """A header block that adds nothing to the table, so that its bytes may be repeated."""
    return hpack.Encoder().encode([hpack.NeverIndexedHeaderTuple(*pair) for pair in pairs])


def call_headers(*extra: tuple[str, str], path: str = STREAM) -> bytes:
    return fields((":method", "POST"), (":scheme", "http"), (":path", path), (":authority", "x"), ("te", "trailers"),
                  ("content-type", "application/grpc"), *extra)


class Connection:
    """A connection whose answers are read and forgotten, unless `unread`. `address` is HOST:PORT or unix:PATH.

    `wrap` turns the socket into one with TLS. `source` is the IP address that it comes from. It takes at most `patience`
    seconds to begin. `ended` is the reason why the server ended it, or None.
    """

    def __init__(self, address: str, settings: bytes = b"", unread: bool = False, wrap=None, source: str = "",
                 patience: float = 10):
        if address.startswith("unix:"):
            self.socket = socket.socket(socket.AF_UNIX)
            self.socket.connect(address.removeprefix("unix:"))
        else:
            host, port = address.rsplit(":", 1)
            self.socket = socket.create_connection((host, int(port)), patience, (source, 0) if source else None)
        if wrap:
            self.socket = wrap(self.socket)
        self.ended: str | None = None
        self.received = 0
        self.socket.sendall(PREFACE + frame(SETTINGS, 0, 0, settings))
        if not unread:
            threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        try:
            while got := self._receive():
                self.received += len(got)
            self.ended = "closed"
        except OSError as error:
            self.ended = self.ended or repr(error)

    def _receive(self) -> bytes:
        while True:
            with contextlib.suppress(TimeoutError):  # a silent server has not ended the connection
                return self.socket.recv(1 << 16)

    def pump(self, chunk, seconds: float) -> int:
        """Sends `chunk`, or what it returns for 0, 1, 2 ..., again and again. Returns how often, until refused."""
        end, sent = time.monotonic() + seconds, 0
        try:
            while time.monotonic() < end and self.ended is None:
                self.socket.sendall(chunk(sent) if callable(chunk) else chunk)
                sent += 1
        except OSError as error:
            self.ended = self.ended or repr(error)
        return sent

    def close(self) -> None:
        """close() alone would leave the connection open while the thread reads from it."""
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
