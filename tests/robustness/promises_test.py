"""A client that asks for 64 promises at a time, with other settings each time: promises_test.py [ROWS | cancelled]

The calls bring ROWS rows of pixels (0). With one row, the server measures for them; without, it does not. `cancelled`: 60
calls with one row come at once and are cancelled after a second, and nothing is measured for them afterwards.
"""
import itertools
import json
import pathlib
import sys
import threading
import time

import harness
from harness import rpc, v1

CALLS, WIDTH, HEIGHT = 64, 3840, 2160
SHORT_S, NIGHTLY_S = 8, 30  # with rows it is a nightly test
CANCELLED = 60
CURVES = [number for number in v1.ToneCurve.values() if number not in (0, v1.TONE_CURVE_TABLE)]
ROW = harness.grey(WIDTH, 1)


def settings(number: int):
    """Every number has settings of its own, with other times for some."""
    return v1.Settings(max_ms=1e8, curve=CURVES[number % len(CURVES)], exposure=v1.Exposure(key=0.1 + number * 1e-6),
                       bloom=v1.Bloom(levels=1 + number % 16))


def promise(number: int, rows: int) -> list:
    requests = [v1.RenderRequest(start=v1.RenderStart(settings=settings(number), frame=harness.header(0, WIDTH, HEIGHT)))]
    return requests + [v1.RenderRequest(band=v1.Band(first_row=row, pixels=ROW)) for row in range(rows)]


class Promises:
    """The attack, for as long as the block runs."""

    def __init__(self, address: str, rows: int):
        self.channel, self.rows = harness.channel(address), rows
        self.stub = rpc.RenderServiceStub(self.channel)
        self.numbers, self.stop = itertools.count(), threading.Event()
        self.threads = [threading.Thread(target=self._ask) for _ in range(CALLS)]

    def _ask(self) -> None:
        while not self.stop.is_set():
            requests = promise(next(self.numbers), self.rows)
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


def measured(daemon: harness.Daemon) -> int:
    """How many kinds of settings the server has measured."""
    kept = pathlib.Path(daemon.folder.name, "cache/tiers.json")
    return len(json.loads(kept.read_text())) if kept.exists() else 0


def attack(daemon: harness.Daemon, rows: int) -> None:
    nightly = rows > 0
    seconds, noise = (NIGHTLY_S, harness.NIGHTLY_NOISE_MS) if nightly else (SHORT_S, harness.SHORT_NOISE_MS)
    control = harness.beside_fair_neighbour(daemon.address, seconds)
    bystander, unwell = harness.Bystander(daemon.address), []
    with Promises(daemon.address, rows) as promises:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            unwell += [path for path in ("/readyz", "/livez") if daemon.get(path)[0] != 200]
            time.sleep(0.5)
        beside = bystander.result()
        asked = next(promises.numbers)
    kinds = measured(daemon)
    harness.report(rows=rows, asked=asked, measured=kinds, control=control, beside=beside, unwell=len(unwell))
    harness.expect(asked >= CALLS, "the attack did not get through")
    harness.expect(kinds > 1 if rows else kinds <= 1, f"{kinds} kinds of settings were measured")
    harness.expect(not unwell, f"{unwell[:3]} failed during {rows} rows")
    harness.expect_undisturbed(beside, control, f"{CALLS} promises with {rows} rows each", noise)


def compile_shaders(address: str) -> None:
    """Measures the settings of the attack, so that their shaders are compiled for the sizes that measuring uses.

    The weights of the metering differ, so that the attack's own settings are still to be measured. While a shader compiles,
    others wait: docs/performance.md. The host's passes compile nothing.
    """
    weights = v1.Settings(exposure=v1.Exposure(metering=v1.Metering(weights=v1.Metering.WEIGHTS_CENTER)))
    for number in range(CANCELLED):
        measured = settings(number)
        measured.MergeFrom(weights)
        ended = harness.render(address, 64, 64, measured, seconds=60)
        harness.expect(ended[0] == "OK", f"{measured}: {ended}")


def cancelled(daemon: harness.Daemon) -> None:
    if harness.passes_of_environment():
        compile_shaders(daemon.address)
    control = harness.beside_fair_neighbour(daemon.address)
    bystander = harness.Bystander(daemon.address)
    channels, over = [harness.channel(daemon.address) for _ in range(8)], threading.Event()

    def held_open(number: int):
        yield from promise(number, rows=1)
        over.wait(20)

    calls = [rpc.RenderServiceStub(channels[number % 8]).Render(held_open(number), timeout=25) for number in range(CANCELLED)]
    time.sleep(1)
    for call in calls:
        call.cancel()
    over.set()
    time.sleep(2)  # what is being measured ends
    before = measured(daemon)
    time.sleep(SHORT_S - 3)
    beside, after = bystander.result(), measured(daemon)
    for channel in channels:
        channel.close()
    harness.report(cancelled=CANCELLED, measured=[before, after], control=control, beside=beside)
    harness.expect(after == before, f"after the calls were cancelled, {after - before} kinds of settings were measured for them")
    harness.expect_undisturbed(beside, control, f"{CANCELLED} promises that are cancelled")


def main() -> None:
    with harness.Daemon("--max-calls", "80") as daemon:
        if sys.argv[1:] == ["cancelled"]:
            cancelled(daemon)
        else:
            attack(daemon, rows=int(sys.argv[1]) if len(sys.argv) > 1 else 0)


main()
