"""Slow clients on the metrics port, fewer and more than it serves at a time: every probe is answered within its second."""
import socket
import threading
import time

from harness import Daemon, expect, record, report

CLIENTS = (100, 300)  # the port has 128 connections at most, and then ends the oldest
SECONDS = 8  # longer than it waits for a request
REQUESTS = [b"", b"GET /metrics HTTP/1.1\r\n", b"GET /metrics HTTP/1.1\r\nX: " + b"y" * 4000]  # each of them unfinished


def slow(address: str, request: bytes, end: float) -> None:
    """Half a request, and then nothing; again when the server gives up."""
    host, port = address.rsplit(":", 1)
    while time.monotonic() < end:
        try:
            with socket.create_connection((host, int(port)), timeout=max(0.1, end - time.monotonic())) as connection:
                connection.sendall(request)
                connection.recv(100)
        except OSError:
            pass
        time.sleep(0.3)  # the probes need this process, too


def unread(address: str, end: float) -> None:
    """Asks for pages and reads none of them."""
    host, port = address.rsplit(":", 1)
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect((host, int(port)))
        connection.sendall(b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n")
        time.sleep(max(0, end - time.monotonic()))


def probe_beside(daemon: Daemon, clients: int) -> float:
    """Probes while so many clients are slow. Returns the seconds that the slowest took."""
    end = time.monotonic() + SECONDS
    threads = [threading.Thread(target=slow, args=(daemon.metrics, REQUESTS[i % len(REQUESTS)], end)) for i in range(clients)]
    threads += [threading.Thread(target=unread, args=(daemon.metrics, end)) for _ in range(10)]
    for thread in threads:
        thread.start()
    time.sleep(0.5)
    answered, failed, slowest = 0, [], 0.0
    while time.monotonic() < end - 1:
        for path in ("/livez", "/readyz", "/metrics"):
            begin = time.monotonic()
            status, text = daemon.get(path, 1)
            slowest = max(slowest, time.monotonic() - begin)
            if status == 200:
                answered += 1
            else:
                failed.append(f"{path}: {status} {text[:60]}")
        time.sleep(0.2)
    for thread in threads:
        thread.join()
    report(clients=len(threads), answered=answered, failed=len(failed), slowest_ms=round(1000 * slowest, 1))
    expect(answered and not failed, f"{len(failed)} of {answered + len(failed)} probes failed: {failed[:2]}")
    return slowest


with Daemon() as daemon:
    slowest = max(probe_beside(daemon, clients) for clients in CLIENTS)
    # The port forgets the slow ones.
    expect(daemon.get("/livez")[0] == 200 and daemon.stop() == 0, "it does not go on as before")
    record("slowest_probe", round(1000 * slowest, 1), "ms")
