"""A client that asks for 64 promises at a time, with other settings each time: promises_test.py [ROWS]

The calls bring ROWS rows of pixels (0). With one row, the server measures for them; without, it does not.
"""
import itertools
import json
import pathlib
import sys
import threading
import time

import harness
from harness import rpc, v1

CALLS, WIDTH, HEIGHT, SECONDS = 64, 3840, 2160, 8
CURVES = [number for number in v1.ToneCurve.values() if number not in (0, v1.TONE_CURVE_TABLE)]
ROW = harness.grey(WIDTH, 1)


def settings(number: int):
    """Every number has settings of its own, with other times for some."""
    return v1.Settings(max_ms=1e8, curve=CURVES[number % len(CURVES)], exposure=v1.Exposure(key=0.1 + number * 1e-6),
                       bloom=v1.Bloom(levels=1 + number % 16))


class Promises:
    """The attack, for as long as the block runs."""

    def __init__(self, address: str, rows: int):
        self.channel, self.rows = harness.channel(address), rows
        self.stub = rpc.RenderServiceStub(self.channel)
        self.numbers, self.stop = itertools.count(), threading.Event()
        self.threads = [threading.Thread(target=self._ask) for _ in range(CALLS)]

    def _ask(self) -> None:
        while not self.stop.is_set():
            requests: list = [v1.RenderRequest(start=v1.RenderStart(settings=settings(next(self.numbers)),
                                                              frame=harness.header(0, WIDTH, HEIGHT)))]
            requests += [v1.RenderRequest(band=v1.Band(first_row=row, pixels=ROW)) for row in range(self.rows)]
            harness.end_of(self.stub.Render(self._held_open(requests), timeout=10))

    def _held_open(self, requests):
        """Ends the upload only when the attack ends, so that the call lasts until its deadline."""
        yield from requests
        if self.rows:
            self.stop.wait(10)

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *unused):
        self.stop.set()
        for thread in self.threads:
            thread.join()
        self.channel.close()


def use_every_curve(address: str) -> None:
    """The first frame with a curve compiles its shaders in one piece, once. That is not what this test is about."""
    for curve, tier in itertools.product(CURVES, ("draft", "standard")):
        code, message = harness.render(address, settings=v1.Settings(curve=curve, tier=tier))
        harness.expect(code == "OK", f"a frame with curve {curve} failed: {message}")


def main() -> None:
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    with harness.Daemon("--max-calls", "80") as daemon:
        use_every_curve(daemon.address)
        control = harness.beside_fair_neighbour(daemon.address)
        bystander = harness.Bystander(daemon.address)
        unwell = []
        with Promises(daemon.address, rows) as attack:
            end = time.monotonic() + SECONDS
            while time.monotonic() < end:
                unwell += [path for path in ("/readyz", "/livez") if daemon.get(path)[0] != 200]
                time.sleep(0.5)
            beside = bystander.result()
            asked = next(attack.numbers)
        kept = pathlib.Path(daemon.folder.name, "cache/tiers.json")
        measured = len(json.loads(kept.read_text())) if kept.exists() else 0
        harness.report(rows=rows, asked=asked, measured=measured, control=control, beside=beside, unwell=len(unwell))
        harness.expect(asked >= CALLS, "the attack did not get through")
        harness.expect(measured > 1 if rows else measured <= 1, f"{measured} kinds of settings were measured")
        harness.expect(not unwell, f"{unwell[:3]} failed during {rows} rows")
        harness.expect_undisturbed(beside, control, f"{CALLS} promises with {rows} rows each")


main()
