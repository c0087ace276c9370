"""The log's reader sleeps: calls, probes and SIGTERM do not wait for it, and what is lost is counted."""
import json
import os
import threading
import time

import harness
from harness import Daemon, expect, report, rpc, v1

CALLS = 6000  # more lines than a pipe and the queue behind it hold
FRAME = harness.grey(1, 1)


def render_many(address: str, first: int, count: int) -> int:
    """Renders frames of one pixel, numbered in their headers; how many came back."""
    done = 0
    with harness.channel(address) as channel:
        stub = rpc.RenderServiceStub(channel)
        for i in range(first, first + count):
            requests = [v1.RenderRequest(start=v1.RenderStart(settings=v1.Settings(), frame=harness.header(i, 1, 1))),
                        v1.RenderRequest(band=v1.Band(first_row=0, pixels=FRAME))]
            ended = harness.end_of(stub.Render(iter(requests), timeout=5))
            if ended[0] != "OK":
                print(f"call {i}: {ended}")
                break
            done += 1
    return done


def lines_of(text: bytes) -> list[dict]:
    return [json.loads(line) for line in text.decode().splitlines()]


def sleeping_reader() -> None:
    reader, writer = os.pipe()
    with Daemon("--log-json", "--drain-timeout", "2s", stderr=writer) as daemon:
        os.close(writer)
        begin = time.monotonic()
        served = render_many(daemon.address, 0, CALLS)
        seconds = time.monotonic() - begin
        probes = {path: daemon.get(path)[0] for path in ("/readyz", "/livez")}
        lost = daemon.series("candela_log_lines_lost_total").get("", 0)
        report(served=served, seconds=round(seconds, 1), lost=lost, probes=probes)
        expect(served == CALLS, f"after {served} calls the service waited for the reader of its log")
        expect(probes == {"/readyz": 200, "/livez": 200}, f"probes: {probes}")
        expect(lost > 0, "no line is counted as lost, and the pipe cannot hold them all")
        # The reader wakes up: it gets the rest in order, and a line that counts the others.
        text = bytearray()
        threading.Thread(target=lambda: [text.extend(part) for part in iter(lambda: os.read(reader, 1 << 16), b"")],
                         daemon=True).start()
        expect(render_many(daemon.address, CALLS, 10) == 10, "calls fail once the log is read again")
        expect(daemon.stop(20) == 0, "it did not end with 0")
        time.sleep(0.5)
        lines = lines_of(bytes(text))
        numbers = [line["sequence"] for line in lines if line["event"] == "render call ended"]
        said = sum(line["lines"] for line in lines if line["event"] == "log lines lost")
        report(read=len(lines), said_lost=said)
        expect(numbers == sorted(numbers), "lines are out of order")
        expect(said == lost, f"{said} lines are said to be lost and {lost} counted")
        expect(len(set(numbers)) + said == CALLS + 10, f"{len(set(numbers))} read + {said} lost is not {CALLS + 10}")
        expect(lines[-1]["event"] == "stopped", f"the last line is {lines[-1]}")
    os.close(reader)


def sigterm_while_it_sleeps() -> None:
    reader, writer = os.pipe()
    with Daemon("--drain-timeout", "2s", stderr=writer) as daemon:
        os.close(writer)
        expect(render_many(daemon.address, 0, 1500) == 1500, "the service waited for the reader of its log")
        begin = time.monotonic()
        code = daemon.stop(20)
        report(exit_code=code, seconds=round(time.monotonic() - begin, 1))
        expect(code == 0, f"SIGTERM: exit code {code} while nobody reads the log")
    os.close(reader)


def awake_reader() -> None:
    """A file, and a pipe that is read, lose nothing."""
    for where in ("file", "pipe"):
        text = bytearray()
        reader, writer = os.pipe()
        with Daemon("--log-json", stderr=writer if where == "pipe" else None) as daemon:
            os.close(writer)
            thread = threading.Thread(target=lambda: [text.extend(p) for p in iter(lambda: os.read(reader, 4096), b"")],
                                      daemon=True)
            thread.start()
            expect(render_many(daemon.address, 0, 1000) == 1000, "calls fail")
            expect(daemon.stop() == 0, "it did not end with 0")
            thread.join(10)
            lines = lines_of(bytes(text) if where == "pipe" else daemon.log.read_bytes())
        os.close(reader)
        numbers = [line["sequence"] for line in lines if line["event"] == "render call ended"]
        expect(numbers == list(range(1000)), f"{where}: {len(numbers)} of 1000 lines are there, or out of order")
        expect(lines[-1]["event"] == "stopped", f"{where}: the last line is {lines[-1]}")


sigterm_while_it_sleeps()
sleeping_reader()
awake_reader()
