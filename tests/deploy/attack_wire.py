"""The means of attacks on a server's HTTP/2: connections, floods and crowds. AIM says where they go, from where and how long."""
import contextlib
import itertools
import pathlib
import socket
import struct
import sys
import time
import types

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "robustness"))
try:
    import h2.config
    import h2.connection
    import http2
except ImportError as missing:
    print(f"skipped: {missing}; run deploy/install-packages.sh test")
    sys.exit(77)
from http2 import GOAWAY, HEADERS, RST_STREAM, STREAM

AIM = types.SimpleNamespace(address="", seconds=0.0, source="")


def connect(**more) -> http2.Connection:
    return http2.Connection(AIM.address, source=AIM.source, **more)


def open_socket() -> socket.socket:
    """A connection without HTTP/2."""
    host, port = AIM.address.rsplit(":", 1)
    return socket.create_connection((host, int(port)), 10, (AIM.source, 0) if AIM.source else None)


def pump(chunk, first: bytes = b"", unread: bool = False) -> dict:
    """Sends `chunk` again and again. Whenever the server ends the connection, goes on with another one."""
    end, sent, connections, last = time.monotonic() + AIM.seconds, 0, 0, ""
    while (left := end - time.monotonic()) > 0:
        try:
            one = connect(unread=unread)
        except OSError as error:
            last = repr(error)
            time.sleep(0.05)
            continue
        connections += 1
        try:
            one.socket.settimeout(max(left, 0.1))
            one.socket.sendall(first)
            sent += one.pump(chunk, left)
        except OSError as error:
            one.ended = repr(error)
        last = one.ended or "kept on"
        one.close()
        if last != "kept on":
            time.sleep(0.01)
    return {"sent": sent, "connections": connections, "end": last}


def grpc_message(message) -> bytes:
    return b"\0" + struct.pack(">I", message.ByteSize()) + message.SerializeToString()


def flood(kept: list[http2.Connection], chunk: bytes, end: float) -> int:
    """Sends `chunk` on all of them until the time `end`, whatever the server does, and closes them. Returns the bytes sent."""
    sent = 0
    for one in kept:
        one.socket.setblocking(False)
    while time.monotonic() < end:
        for one in kept:
            with contextlib.suppress(OSError):
                sent += one.socket.send(chunk)
    for one in kept:
        one.close()
    return sent


def unread(chunk: bytes, connections: int = 4) -> dict:
    """Sends `chunk` on some connections, and reads none of the answers: each one waits in the server. A connection that the
    server ends or refuses is tried again at once."""
    end, begun, refused, sent = time.monotonic() + AIM.seconds, 0, 0, 0
    kept: list[http2.Connection | None] = [None] * connections
    while time.monotonic() < end:
        for number, one in enumerate(kept):
            try:
                if one is None:
                    one = kept[number] = connect(unread=True, patience=0.02)
                    one.socket.setblocking(False)
                    begun += 1
                sent += one.socket.send(chunk)
            except BlockingIOError:
                pass
            except OSError:
                if one:
                    one.close()
                else:
                    refused += 1
                kept[number] = None
    for one in filter(None, kept):
        one.close()
    return {"connections": begun, "refused": refused, "mib": sent >> 20}


def let_through(true: bool, what: str) -> dict:
    return {"wrong": f"the server let this through: {what}"} if true else {}


def answer(sent: bytes, seconds: float = 5) -> str:
    """What the server does about `sent`, the first bytes of a connection: the frame that answers or ends it, or nothing."""
    with open_socket() as wire:
        wire.settimeout(seconds)
        got = b""
        try:
            wire.sendall(sent)
            while len(got) < 1 << 16:
                more = wire.recv(1 << 16)
                if not more:
                    return "closed"
                got += more
                while len(got) >= 9 and len(got) >= 9 + int.from_bytes(got[:3], "big"):
                    if got[3] in (HEADERS, RST_STREAM, GOAWAY):
                        return {HEADERS: "answered", RST_STREAM: "reset", GOAWAY: "ended"}[got[3]]
                    got = got[9 + int.from_bytes(got[:3], "big"):]
        except TimeoutError:
            return ""
        except OSError:
            return "closed"
    return "not HTTP/2"


def each_answered(variants: dict[str, bytes], refusals: tuple[str, ...]) -> dict:
    """Sends each of the variants again and again, on connections of their own. The server must do one of `refusals` at once."""
    end, sent, first, bad = time.monotonic() + AIM.seconds, 0, {}, {}
    for name in itertools.cycle(variants):
        if time.monotonic() > end and sent >= len(variants):
            break
        what, sent = answer(variants[name]), sent + 1
        # A later call may exceed the front's rate, and then it is answered that it does.
        if what not in refusals and not (name in first and what == "answered"):
            bad[name] = what
        first.setdefault(name, what)
    return {"connections": sent, "answers": first} | let_through(bool(bad), str(bad))


def within_windows(wire: socket.socket, first: bytes, again: bytes, end: float):
    """One call that sends `first` and then `again` and again, as fast as the server's windows let it. Yields the bytes."""
    one = h2.connection.H2Connection(h2.config.H2Configuration(header_encoding=None))
    one.initiate_connection()
    one.send_headers(1, [(":method", "POST"), (":scheme", "http"), (":path", STREAM), (":authority", "x"), ("te", "trailers"),
                         ("content-type", "application/grpc")])
    waiting = first
    wire.settimeout(0.05)
    while time.monotonic() < end:
        room = min(one.local_flow_control_window(1), one.max_outbound_frame_size)
        if room > 0:
            waiting = waiting or again
            one.send_data(1, waiting[:room])
        wire.sendall(one.data_to_send())
        if room > 0:
            yield len(waiting[:room])
            waiting = waiting[room:]
        else:
            with contextlib.suppress(TimeoutError):
                got = wire.recv(1 << 16)
                if not got:
                    return
                one.receive_data(got)


def crowd(count: int, whole: bytes, at_once: int, seconds: float, each_second: bool = False) -> dict:
    """Opens `count` connections, sends the first `at_once` bytes of `whole` on each, then perhaps one byte a second. They stay
    open for `seconds`."""
    kept, tried, refused, most = [], 0, 0, time.monotonic() + max(AIM.seconds / 2, 10)
    while tried < count and time.monotonic() < most:  # a firewall does not answer
        tried += 1
        try:
            kept.append(connect(patience=1))
            kept[-1].socket.sendall(whole[:at_once])
        except OSError:
            refused += 1
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(min(1, max(0, end - time.monotonic())))
        for one in kept if each_second and at_once < len(whole) - 1 else []:
            try:
                one.socket.sendall(whole[at_once:at_once + 1])
            except OSError:
                one.ended = one.ended or "closed"
        at_once += 1
    ended = sum(one.ended is not None for one in kept)
    for one in kept:
        one.close()
    return {"connections": len(kept), "tried": tried, "refused": refused, "ended_by_server": ended}


def too_few(did: dict, count: int) -> dict:
    """An attack on far fewer connections than `count` says nothing."""
    reached = did["connections"]
    return {"wrong": f"the attack reached only {reached} of {count} connections"} if reached < 0.9 * count else {}
