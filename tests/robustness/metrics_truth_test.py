"""Refusals and ends of frames are counted by what happened, seen from outside: calls, sessions, tokens, promises, memory."""
import threading

import harness
from harness import Daemon, expect, report, rpc, v1


class Counted:
    """What changes in candela_rejections_total and candela_frames_total."""

    def __init__(self, daemon: Daemon):
        self.daemon = daemon
        self.stub = rpc.RenderServiceStub(daemon.channel())
        self.wrong: list[str] = []

    def look(self) -> dict[str, float]:
        seen = {}
        for name in ("candela_rejections_total", "candela_frames_total"):
            seen |= self.daemon.series(name)
        return seen

    def stream(self, *requests) -> str:
        return harness.end_of(self.stub.Stream(iter(requests), timeout=20))[0]

    def render(self, settings=None, width=64, height=36) -> str:
        return harness.end_of(self.stub.Render(harness.render_requests(width, height, settings), timeout=20))[0]

    def expect(self, what: str, code: str, counts: dict[str, float], act) -> None:
        before = self.look()
        got = act()
        after = self.look()
        changed = {labels: value - before.get(labels, 0) for labels, value in after.items() if value != before.get(labels, 0)}
        report(case=what, ends=got, counted=changed)
        if (got, changed) != (code, counts):
            self.wrong.append(f"{what}: {got}, counted {changed}; it must be {code}, {counts}")


def opened(name: str, **fields) -> v1.StreamRequest:
    return v1.StreamRequest(open=v1.StreamOpen(session=name, **fields))


def main() -> None:
    with Daemon("--idle-timeout", "2s", "--memory-budget", "64MiB") as daemon:
        c = Counted(daemon)
        token, wrong = 'reason="token"', v1.Settings(prescale=-1)
        c.expect("a token made up", "FAILED_PRECONDITION", {token: 1},
                 lambda: c.stream(opened("a", resume_token=b"x" * 50)))
        answers = list(c.stub.Stream(iter([opened("real"), *harness.frame_requests(0, 8, 8)]), timeout=20))
        real = next(answer.header.resume_token for answer in answers if answer.HasField("header"))
        c.expect("a token of another session", "FAILED_PRECONDITION", {token: 1},
                 lambda: c.stream(opened("b", resume_token=real)))
        c.expect("a token that was changed", "FAILED_PRECONDITION", {token: 1},
                 lambda: c.stream(opened("real", resume_token=real[:-1] + bytes([real[-1] ^ 1]))))
        c.expect("wrong settings at the open", "INVALID_ARGUMENT", {'reason="request"': 1},
                 lambda: c.stream(opened("s", settings=wrong)))
        c.expect("wrong settings later", "INVALID_ARGUMENT", {'reason="request"': 1},
                 lambda: c.stream(opened("s"), v1.StreamRequest(change=v1.SettingsChange(from_sequence=0, settings=wrong))))
        large = v1.StreamRequest(frame=harness.header(0, 20000, 1))
        c.expect("a frame beyond max-dimension", "RESOURCE_EXHAUSTED", {'reason="size"': 1},
                 lambda: c.stream(opened("s"), large))
        c.expect("a look-ahead that never fits", "RESOURCE_EXHAUSTED", {'reason="size"': 1},
                 lambda: c.stream(opened("s", lookahead=16), v1.StreamRequest(frame=harness.header(0, 2000, 2000))))
        start = next(harness.render_requests(4000, 4000, v1.Settings(max_error_codes=0)))
        c.expect("the start of a frame that never fits, with a promise", "RESOURCE_EXHAUSTED", {'reason="size"': 1},
                 lambda: harness.end_of(c.stub.Render(iter([start]), timeout=20))[0])
        memory_is_taken(c)
        half = [opened("h"), v1.StreamRequest(frame=harness.header(0, 64, 64)),
                v1.StreamRequest(band=v1.Band(first_row=0, pixels=harness.grey(64, 32)))]
        c.expect("half a frame, then silence", "UNAVAILABLE", {'result="cancelled"': 1}, lambda: silence(c.stub.Stream, half))
        image = [next(harness.render_requests(64, 36)), v1.RenderRequest(band=v1.Band(first_row=0, pixels=harness.grey(64, 1)))]
        c.expect("a row of an image, then silence", "DEADLINE_EXCEEDED", {'result="cancelled"': 1},
                 lambda: silence(c.stub.Render, image))
        c.expect("half a frame, then the end", "INVALID_ARGUMENT", {'result="invalid_argument"': 1}, lambda: c.stream(*half))
        expect(not c.wrong, "; ".join(c.wrong))
        expect(daemon.stop() == 0, "it did not end with 0")


def silence(method, requests) -> str:
    over = threading.Event()

    def slowly():
        yield from requests
        over.wait(20)

    code = harness.end_of(method(slowly(), timeout=20))[0]
    over.set()
    return code


def memory_is_taken(c: Counted) -> None:
    """A session with look-ahead holds the memory, row by row; another one waits for the idle timeout in vain."""
    over = threading.Event()
    row = harness.grey(1100, 1)

    def holding():
        yield opened("holder", lookahead=2)
        yield v1.StreamRequest(frame=harness.header(0, 1100, 700))
        for y in range(200):
            yield v1.StreamRequest(band=v1.Band(first_row=y, pixels=row))
            if over.wait(0.2):
                return

    holder = c.stub.Stream(holding(), timeout=60)
    over.wait(0.5)
    c.expect("a session that finds no memory", "UNAVAILABLE", {'reason="memory"': 1},
             lambda: c.stream(opened("m", lookahead=2), v1.StreamRequest(frame=harness.header(0, 1100, 700)),
                              v1.StreamRequest(band=v1.Band(first_row=0, pixels=row))))
    over.set()
    harness.end_of(holder)


main()
