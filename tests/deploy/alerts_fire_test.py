"""Provokes every alert of deploy/alerts.yaml: real servers, real mistakes, a real Prometheus that scrapes them.

  alerts_fire_test.py BIN        # the folder with candelad, candela and losing_candelad

The rules are the shipped ones; only their waits and windows are seconds instead of minutes. No alert may fire before its
mistake is made. Exits with 77 and a reason if there is no Prometheus or no nginx.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
os.environ["CANDELA_BIN"] = sys.argv[1]
sys.path.insert(0, str(ROOT / "tests/robustness"))
import harness  # noqa: E402
import http2  # noqa: E402
from harness import Daemon, expect, report, rpc, skip, v1  # noqa: E402
from shapes import Front  # noqa: E402

DEPLOY = ROOT / "deploy"
WITHIN_S = 60
SECONDS = {"5m": "8s", "10m": "8s", "15m": "30s", "30m": "90s"}  # the windows of the rules
# What a mistake may set off besides its own alert.
ALSO = {"CandelaMemoryNearlyFull": {"CandelaTurnsAway"}, "CandelaRestarts": {"CandelaNotReady"},
        "CandelaDeviceLost": {"CandelaNotReady"},  # that server ends
        "CandelaFrontDown": {"CandelaNotReady"}}


def short_rules(text: str) -> str:
    text = re.sub(r"for: \d+m", "for: 2s", text)
    return re.sub(r"\[(\d+m)\]", lambda window: f"[{SECONDS[window[1]]}]", text)


class Prometheus:
    def __init__(self, targets: list[str]):
        self.folder = tempfile.TemporaryDirectory(prefix="candela-alerts-")
        folder = pathlib.Path(self.folder.name)
        (folder / "alerts.yaml").write_text(short_rules((DEPLOY / "alerts.yaml").read_text()))
        self.targets = folder / "targets.json"
        self.scrape(targets)
        config, count = re.subn(r"static_configs:\n +- targets: .*\n", "file_sd_configs: [{files: [targets.json], refresh_interval: 1s}]\n",
                                (DEPLOY / "prometheus.yaml").read_text().replace("15s", "1s"))
        expect(count == 1, "deploy/prometheus.yaml has no static target to replace")
        (folder / "prometheus.yaml").write_text(config)
        self.made = set()  # the alerts that the mistakes so far may set off
        self.address = f"127.0.0.1:{harness.free_port()}"
        self.log = open(folder / "log", "wb")
        self.process = subprocess.Popen(
            ["prometheus", f"--config.file={folder}/prometheus.yaml", f"--storage.tsdb.path={folder}/data",
             f"--web.listen-address={self.address}", "--log.level=warn"], stdout=self.log, stderr=self.log)

    def scrape(self, targets: list[str]) -> None:
        """From now on, these; returns at once."""
        new = self.targets.with_suffix(".new")
        new.write_text(json.dumps([{"targets": targets}]))
        new.rename(self.targets)

    def wait_for_targets(self, count: int) -> None:
        end = time.monotonic() + 30
        while self.targets_up() != count:
            expect(time.monotonic() < end, f"Prometheus reaches {self.targets_up()} servers, not {count}")
            time.sleep(0.2)

    def get(self, path: str) -> dict:
        try:
            with urllib.request.urlopen(f"http://{self.address}{path}", timeout=5) as page:
                return json.load(page)["data"]
        except OSError:
            return {}

    def firing(self) -> dict[str, str]:
        """Names and summaries of the alerts that fire. Each must be one that a mistake may have set off."""
        end = time.monotonic() + 30
        while "alerts" not in (answer := self.get("/api/v1/alerts")):
            expect(time.monotonic() < end, "Prometheus does not answer")
        firing = {alert["labels"]["alertname"]: alert["annotations"]["summary"] for alert in answer["alerts"]
                  if alert["state"] == "firing"}
        expect(firing.keys() <= self.made, f"these fire without a reason: {firing.keys() - self.made}")
        return firing

    def about_to_provoke(self, alert: str) -> None:
        """Call it before the mistake for `alert`, which must not fire yet."""
        self.firing()
        self.made |= {alert} | ALSO.get(alert, set())

    def targets_up(self) -> int:
        return sum(target["health"] == "up" for target in self.get("/api/v1/targets?state=active").get("activeTargets", []))

    def wait_for(self, alert: str, provoke=lambda: None) -> None:
        """Provokes it again and again until it fires."""
        self.about_to_provoke(alert)
        begin = time.monotonic()
        while alert not in (firing := self.firing()):
            expect(time.monotonic() - begin < WITHIN_S, f"{alert} did not fire within {WITHIN_S} s")
            provoke()
            time.sleep(0.5)
        report(alert=alert, seconds=round(time.monotonic() - begin, 1), summary=firing[alert])

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.folder.cleanup()


def stream(daemon: Daemon, *requests, token: bytes = b"") -> str:
    with daemon.channel() as channel:
        requests = [v1.StreamRequest(open=v1.StreamOpen(session=f"s{time.monotonic_ns()}", resume_token=token)), *requests]
        return harness.end_of(rpc.RenderServiceStub(channel).Stream(iter(requests), timeout=20))[0]


@contextlib.contextmanager
def bench(daemon: Daemon, *options: str):
    process = subprocess.Popen([harness.binary("candela"), "bench", "--server", daemon.address, "--seconds", "600", "-q", *options],
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


class Holders:
    """Sessions, each on its own connection, that hold a frame's memory by sending a row now and then."""

    def __init__(self, daemon: Daemon, size: int):
        self.daemon, self.size, self.over, self.threads = daemon, size, threading.Event(), []

    def add(self) -> None:
        self.threads.append(threading.Thread(target=self._hold, daemon=True))
        self.threads[-1].start()

    def _requests(self):
        yield v1.StreamRequest(open=v1.StreamOpen(session=f"h{time.monotonic_ns()}"))
        yield v1.StreamRequest(frame=harness.header(0, self.size, self.size))
        for y in range(self.size):
            yield v1.StreamRequest(band=v1.Band(first_row=y, pixels=harness.grey(self.size, 1)))
            if self.over.wait(0.3):
                return

    def _hold(self) -> None:
        with self.daemon.channel() as channel:
            harness.end_of(rpc.RenderServiceStub(channel).Stream(self._requests(), timeout=300))

    def stop(self) -> None:
        self.over.set()
        for thread in self.threads:
            thread.join(20)


def lose_devices(prometheus: Prometheus, targets: list[str]) -> None:
    """A server that loses its first devices, one for each frame."""
    os.environ["CANDELAD"] = f"{sys.argv[1]}/losing_candelad"
    with Daemon() as lost:
        del os.environ["CANDELAD"]
        prometheus.scrape([*targets, lost.metrics])
        prometheus.wait_for_targets(len(targets) + 1)
        time.sleep(1.5)
        prometheus.about_to_provoke("CandelaDeviceLost")
        code = harness.render(lost.address, 8, 8)[0]
        expect(code == "UNAVAILABLE", f"a frame on a lost device ended with {code}")
        prometheus.wait_for("CandelaDeviceLost")
    prometheus.scrape(targets)


def fill_server(prometheus: Prometheus, daemon: Daemon) -> None:
    holders = Holders(daemon, 256)

    def fill():
        used = daemon.series("candela_memory_bytes").get('pool="textures_in_use"', 0)
        if used < 0.92 * daemon.series("candela_memory_budget_bytes")[""]:
            holders.add()

    prometheus.wait_for("CandelaMemoryNearlyFull", fill)
    # More sessions than it takes: some wait for memory in vain, and then none gets in.
    prometheus.wait_for("CandelaTurnsAway", lambda: [holders.add() for _ in range(10)])
    holders.stop()


def provoke_with_clients(prometheus: Prometheus, plain: Daemon, tight: Daemon, guarded: Daemon, log: int) -> None:
    prometheus.wait_for("CandelaRefusesTokens", lambda: stream(plain, token=b"x" * 50))
    prometheus.wait_for("CandelaRefusesAccess", lambda: [harness.render(guarded.address, 8, 8) for _ in range(5)])
    prometheus.wait_for("CandelaFramesFail", lambda: stream_late_frames(tight))
    os.close(log)  # and nobody reads the log of `tight` any more
    prometheus.wait_for("CandelaLosesLogLines", lambda: harness.render(tight.address, 8, 8))
    prometheus.about_to_provoke("CandelaRefusesConnections")
    connections = [http2.Connection(tight.address, unread=True) for _ in range(20)]
    prometheus.wait_for("CandelaRefusesConnections", lambda: connections.append(http2.Connection(tight.address, unread=True)))
    for connection in connections:
        connection.close()


def stream_late_frames(daemon: Daemon) -> None:
    """A session whose frames take longer to arrive than they may."""
    def requests():
        yield v1.StreamRequest(open=v1.StreamOpen(session=f"l{time.monotonic_ns()}"))
        for sequence in range(5):
            yield v1.StreamRequest(frame=harness.header(sequence, 64, 64, timeout_ms=1))
            for first in (0, 32):
                yield v1.StreamRequest(band=v1.Band(first_row=first, pixels=harness.grey(64, 32)))
                time.sleep(0.05)

    with daemon.channel() as channel:
        harness.end_of(rpc.RenderServiceStub(channel).Stream(requests(), timeout=20))


def provoke_with_load(prometheus: Prometheus, plain: Daemon, small: Daemon) -> None:
    fill_server(prometheus, small)
    reference = v1.Settings(tier="reference")
    prometheus.wait_for("CandelaSlowFrames", lambda: harness.render(plain.address, 2560, 1440, reference, seconds=60))
    with bench(plain, "--sessions", "8", "--size", "3840x2160"):
        prometheus.wait_for("CandelaQueueWaits")


def certify(folder: pathlib.Path, days: int) -> None:
    """A certificate for so many days, in server.crt and server.key; both are replaced."""
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", str(days),
                    "-subj", "/CN=candelad", "-keyout", folder / "new.key", "-out", folder / "new.crt"], check=True, capture_output=True)
    for ending in (".key", ".crt"):
        (folder / f"new{ending}").rename(folder / f"server{ending}")


def restarted(daemon: Daemon, *options: str) -> Daemon:
    """Another process at the addresses of one that was killed."""
    daemon.process.kill()
    daemon.process.wait()
    again = Daemon(*options, "--metrics", daemon.metrics, listen=daemon.address, metrics=False)
    again.metrics = daemon.metrics
    expect(again.listening, f"it did not start again: {again.words()}")
    return again


def main() -> None:
    if not shutil.which("prometheus"):
        skip("no prometheus; as root: apt-get install prometheus")
    names = re.findall(r"^ *- alert: (\w+)$", (DEPLOY / "alerts.yaml").read_text(), flags=re.M)
    with contextlib.ExitStack() as stack:
        folder = pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / "tokens").write_text("0123456789abcdef0123456789abcdef\n")
        (folder / "tokens").chmod(0o600)
        log, writer = os.pipe()  # it takes 64 KiB before somebody has to read it
        plain = stack.enter_context(Daemon(listen=f"unix:{folder}/candelad.sock"))
        tight = stack.enter_context(Daemon("--max-connections", "12", "--idle-timeout", "1s", stderr=writer))
        small = stack.enter_context(Daemon("--memory-budget", "16MiB", "--max-sessions", "40", "--idle-timeout", "10s"))
        guarded = stack.enter_context(Daemon("--token-file", str(folder / "tokens")))
        certify(folder, days=60)
        secure = stack.enter_context(Daemon("--tls-cert", str(folder / "server.crt"), "--tls-key", str(folder / "server.key")))
        front = stack.enter_context(Front(plain.address))
        targets = [f"127.0.0.1:{front.status}", *(daemon.metrics for daemon in (plain, tight, small, guarded, secure))]
        prometheus = Prometheus(targets)
        stack.callback(prometheus.close)
        prometheus.wait_for_targets(6)
        expect(harness.render(front.address)[0] == "OK", "a render fails")
        time.sleep(12)  # longer than the waits and the windows
        prometheus.firing()
        seen = watch(prometheus, names)
        provoke_with_clients(prometheus, plain, tight, guarded, log)
        lose_devices(prometheus, targets)
        provoke_with_load(prometheus, plain, small)
        prometheus.about_to_provoke("CandelaCertificateExpires")
        certify(folder, days=3)
        prometheus.wait_for("CandelaCertificateExpires")
        prometheus.about_to_provoke("CandelaFrontDown")
        front.process.send_signal(signal.SIGQUIT)
        prometheus.wait_for("CandelaFrontDown")
        prometheus.scrape(targets[1:])  # so that CandelaNotReady can end
        prometheus.about_to_provoke("CandelaRestarts")
        for _ in range(2):
            time.sleep(2)
            guarded = stack.enter_context(restarted(guarded))
        prometheus.wait_for("CandelaRestarts")
        expect(harness.wait_until(lambda: "CandelaNotReady" not in prometheus.firing(), WITHIN_S), "CandelaNotReady goes on")
        tight.process.kill()
        prometheus.wait_for("CandelaNotReady")
        prometheus.about_to_provoke("CandelaDown")
        for daemon in (plain, small, guarded, secure):
            daemon.process.kill()
        prometheus.wait_for("CandelaDown")
        missing = set(names) - seen()
        expect(not missing, f"this test provokes no {', '.join(sorted(missing))}")


def watch(prometheus: Prometheus, names: list[str]):
    """Every alert that is waited for is noted; returns a function that says which."""
    waited: set[str] = set()
    wait = prometheus.wait_for

    def noting(alert: str, provoke=lambda: None) -> None:
        expect(alert in names, f"there is no alert {alert}")
        wait(alert, provoke)
        waited.add(alert)

    prometheus.wait_for = noting
    return lambda: waited


main()
