"""A server that is far away gets frames as fast as one nearby, as far as its link allows: more than a band in each round trip."""
import json
import queue
import socket
import subprocess
import threading
import time

import harness

DELAY_SECONDS = 0.025  # in each direction
BAND_BYTES, FRAME_BYTES = 2 << 20, 1920 * 1080 * 8


def pump(source: socket.socket, sink: socket.socket) -> None:
    """Passes bytes on, each DELAY_SECONDS after it came."""
    waiting: queue.Queue = queue.Queue()

    def send() -> None:
        while True:
            due, data = waiting.get()
            time.sleep(max(0.0, due - time.monotonic()))
            try:
                sink.sendall(data) if data else sink.shutdown(socket.SHUT_WR)
            except OSError:
                return
            if not data:
                return

    threading.Thread(target=send, daemon=True).start()
    data = b"-"
    while data:
        try:
            data = source.recv(1 << 20)
        except OSError:
            data = b""
        waiting.put((time.monotonic() + DELAY_SECONDS, data))


def far_away(address: str) -> str:
    """The address of a proxy that is as far from `address` as the delay says."""
    host, port = address.rsplit(":", 1)
    listener = socket.create_server(("127.0.0.1", 0))

    def accept() -> None:
        while True:
            near, _ = listener.accept()
            far = socket.create_connection((host, int(port)))
            for one, other in ((near, far), (far, near)):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=pump, args=(one, other), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    return "127.0.0.1:%d" % listener.getsockname()[1]


def frames_per_second(address: str) -> float:
    done = subprocess.run([harness.binary("candela"), "bench", "--server", address, "--seconds", "4", "--transport", "grpc",
                           "--json", "-", "-q"], check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)["frames_per_second"]


def main() -> None:
    with harness.Daemon() as daemon:
        near, far = frames_per_second(daemon.address), frames_per_second(far_away(daemon.address))
    a_band_each_time = BAND_BYTES / (2 * DELAY_SECONDS) / FRAME_BYTES
    harness.report(near=near, far=far, a_band_each_time=round(a_band_each_time, 2))
    harness.expect(far > 2 * a_band_each_time, f"{far:.1f} frames/s came across; the windows of HTTP/2 stay small")


main()
