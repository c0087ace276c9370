"""A client that behaves: a session of 160x90 at five frames a second, until a line comes on stdin. Prints its latencies.

    bystander.py ADDRESS [--ca FILE] [--token TOKEN] [--name AUTHORITY]

Prints "going" when its first frame has come back. If its session breaks, it counts that and opens another one.
"""
import argparse
import json
import queue
import sys
import threading
import time

import harness
from harness import grpc, rpc, v1

WIDTH, HEIGHT, PERIOD = 160, 90, 0.2
PIXELS = harness.grey(WIDTH, HEIGHT)


class Session:
    """Sends a frame every PERIOD whatever comes back, as a camera does."""

    def __init__(self, stub, metadata, stop: threading.Event):
        self.stub, self.metadata, self.stop = stub, metadata, stop
        self.sent: dict[int, float] = {}
        self.latencies: list[float] = []
        self.room: queue.Queue = queue.Queue()

    def requests(self):
        yield v1.StreamRequest(open=v1.StreamOpen(session=f"bystander-{time.time_ns()}"))
        due, sequence = time.monotonic(), 0
        while not self.stop.is_set():
            # A frame that finds no room is sent late, and its wait counts from when it was due.
            self.sent[sequence] = due
            yield from harness.frame_requests(sequence, WIDTH, HEIGHT, PIXELS)
            sequence, due = sequence + 1, due + PERIOD
            self.stop.wait(max(0.0, due - time.monotonic()))

    def run(self, going) -> None:
        for response in self.stub.Stream(self.requests(), metadata=self.metadata):
            last_row = response.HasField("band") and response.band.first_row + len(response.band.pixels) // (WIDTH * 4)
            if last_row == HEIGHT:
                self.latencies.append(time.monotonic() - self.sent.pop(min(self.sent)))
                going()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("--ca")
    parser.add_argument("--token")
    parser.add_argument("--name")
    options = parser.parse_args()
    credentials = None
    if options.ca:
        credentials = grpc.ssl_channel_credentials(open(options.ca, "rb").read())
    arguments = [("grpc.ssl_target_name_override", options.name)] if options.name else []
    metadata = [("authorization", f"Bearer {options.token}")] if options.token else []
    stop, said = threading.Event(), threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), stop.set()), daemon=True).start()

    def going():
        if not said.is_set():
            said.set()
            print("going", flush=True)

    latencies, errors = [], []
    while not stop.is_set():
        channel = (grpc.secure_channel(options.address, credentials, arguments) if credentials
                   else harness.channel(options.address))
        session = Session(rpc.RenderServiceStub(channel), metadata, stop)
        try:
            session.run(going)
        except grpc.RpcError as error:
            errors.append(f"{error.code().name}: {error.details()}"[:120])
            stop.wait(0.2)
        now = time.monotonic()
        latencies += session.latencies + [now - at for at in session.sent.values() if now - at > PERIOD]
        channel.close()
        if len(errors) > 50:
            break
    if not said.is_set():
        print("not going")
    latencies.sort()

    def quantile(part: float) -> float | None:
        return round(1000 * latencies[min(len(latencies) - 1, int(part * len(latencies)))], 1) if latencies else None

    print(json.dumps({"frames": len(latencies), "errors": len(errors), "first_errors": errors[:3], "p50_ms": quantile(0.5),
                      "p99_ms": quantile(0.99), "max_ms": quantile(1.0)}))


main()
