"""Attacks from outside on a candelad, and what their verdicts need: a daemon of one's own, calls, a look at the process.

Every test is one file with a `main()`. It attacks, measures, and ends by expect() or skip(). Runs with Debian's Python,
which has Debian's gRPC and h2. CANDELAD and CANDELA name other binaries, for example an older build's.
"""
import contextlib
import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/net"))
SKIPPED = 77
# What a p99 may have more than twice its control's, for the noise of the machine. A short run on a busy machine has few frames,
# so one late frame is its p99. The tests with the label nightly are longer, and the machine has nothing else to do.
SHORT_NOISE_MS, NIGHTLY_NOISE_MS = 200, 40
FRAME_NS = 40_000_000  # of media time, between the frames of a session


def passes_of_environment() -> dict[str, str]:
    """CANDELA_TEST_EXECUTOR for a candelad, as tests/support/device_fixture.h has it."""
    return {"CANDELA_EXECUTOR": os.environ["CANDELA_TEST_EXECUTOR"]} if "CANDELA_TEST_EXECUTOR" in os.environ else {}


def skip(reason: str) -> None:
    print(f"skipped: {reason}")
    sys.exit(SKIPPED)


def expect(true: object, message: str) -> None:
    if not true:
        raise SystemExit(f"failed: {message}")


def report(**figures) -> None:
    """A line of figures, for people."""
    print(json.dumps(figures), flush=True)


def record(figure: str, value: float, unit: str, **against: float) -> None:
    """Appends a figure to the file that CANDELA_TEST_FIGURES names, once a test has passed. tests/promises.toml has its name.

    `against` is the same of the control, or from before.
    """
    if path := os.environ.get("CANDELA_TEST_FIGURES"):
        with open(path, "a") as file:
            file.write(json.dumps({"figure": figure, "value": value, "unit": unit, **against}) + "\n")


def record_p99(figure: str, attacked: dict, control: dict) -> None:
    record(figure, attacked["p99_ms"], "ms", against=control["p99_ms"])


try:
    import grpc
    from wire import make_stubs
    _stubs = tempfile.TemporaryDirectory(prefix="candela-stubs-")
    make_stubs(pathlib.Path(_stubs.name))
    from candela.v1 import render_pb2 as v1
    from candela.v1 import render_pb2_grpc as rpc
except (ImportError, FileNotFoundError) as missing:
    skip(f"{missing}; run deploy/install-packages.sh test")


def binary(name: str) -> str:
    """The program under test: from the variable with its name in capitals, or of the build that runs this test."""
    return os.environ.get(name.upper()) or str(pathlib.Path(os.environ.get("CANDELA_BIN", ROOT / "build/release/bin")) / name)


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Daemon:
    """A candelad of the test's own, on a free port of loopback, with metrics. Use it as a context manager.

    `preexec` runs in the child before candelad does, for example to set limits. `listening` is False if it did not start
    within `wait` seconds.
    """

    def __init__(self, *options: str, listen: str = "", env: dict | None = None, preexec=None, stderr=None,
                 wait: float = 60, metrics: bool = True):
        self.folder = tempfile.TemporaryDirectory(prefix="candela-attacked-")
        self.log = pathlib.Path(self.folder.name) / "log"
        self.address = listen or "127.0.0.1:0"  # candelad chooses a port, which it prints
        self.metrics = f"127.0.0.1:{free_port()}" if metrics else ""
        command = [binary("candelad"), "--listen", self.address, *options]
        if metrics:
            command += ["--metrics", self.metrics]
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                            stderr=stderr if stderr is not None else log,
                                            env=os.environ | passes_of_environment() | (env or {}), preexec_fn=preexec)
        self.pid = self.process.pid
        self.listening = self._wait_until_listening(wait)

    def _wait_until_listening(self, wait: float) -> bool:
        os.set_blocking(self.process.stdout.fileno(), False)
        said, end = b"", time.monotonic() + wait
        while time.monotonic() < end and self.process.poll() is None and b"\n" not in said:
            said += self.process.stdout.read() or b""
            time.sleep(0.02)
        listening = re.match(rb"listening on ([^\s,]+)", said)
        if listening and self.address.endswith(":0"):
            self.address = listening[1].decode()
        return bool(listening)

    def __enter__(self):
        expect(self.listening, f"candelad did not start: {self.words()}")
        return self

    def __exit__(self, *unused):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.folder.cleanup()

    def alive(self) -> bool:
        return self.process.poll() is None

    def stop(self, seconds: float = 60) -> int | None:
        """The exit code after SIGTERM; None if it goes on for longer than that."""
        if self.alive():
            self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def words(self) -> str:
        return self.log.read_text(errors="replace") if self.log.exists() else ""

    def resident_mib(self) -> float:
        status = pathlib.Path(f"/proc/{self.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status).group(1)) / 1024

    def get(self, path: str, seconds: float = 3) -> tuple[int, str]:
        """Status and body of a page of the metrics port; 0 if it did not answer in time."""
        try:
            with urllib.request.urlopen(f"http://{self.metrics}{path}", timeout=seconds) as page:
                return page.status, page.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()
        except OSError as error:
            return 0, repr(error)

    def series(self, name: str) -> dict[str, float]:
        """The values of a metric by its labels, for example {'reason="token"': 1.0}; {'': v} without labels."""
        found = re.findall(rf"^{name}(?:{{(.*?)}})? (\S+)$", self.get("/metrics")[1], re.M)
        return {labels: float(value) for labels, value in found}

    def channel(self) -> grpc.Channel:
        return channel(self.address)


def wait_until(true, seconds: float) -> bool:
    """Asks `true` again and again, for that long at most."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.1)
    return False


def channel(address: str) -> grpc.Channel:
    """A connection of its own, shared with no other channel."""
    return grpc.insecure_channel(address, options=[("grpc.max_receive_message_length", 64 << 20),
                                                   ("grpc.use_local_subchannel_pool", 1)])


def grey(width: int, height: int) -> bytes:
    """The pixels of a frame of half floats."""
    return struct.pack("<4e", 0.5, 0.5, 0.5, 1.0) * (width * height)


def header(sequence: int, width: int, height: int, **more) -> v1.FrameHeader:
    fields = {"sequence": sequence, "width": width, "height": height, "format": v1.PIXEL_FORMAT_RGBA16F,
              "media_time_ns": sequence * FRAME_NS} | more
    return v1.FrameHeader(**fields)


def bands(width: int, height: int, pixels: bytes):
    rows = max(1, (2 << 20) // (width * 8))
    for y in range(0, height, rows):
        yield v1.Band(first_row=y, pixels=pixels[y * width * 8:(y + rows) * width * 8])


def render_requests(width: int, height: int, settings=None, pixels: bytes | None = None):
    yield v1.RenderRequest(start=v1.RenderStart(settings=settings or v1.Settings(), frame=header(0, width, height)))
    for band in bands(width, height, grey(width, height) if pixels is None else pixels):
        yield v1.RenderRequest(band=band)


def frame_requests(sequence: int, width: int, height: int, pixels: bytes | None = None, **more):
    yield v1.StreamRequest(frame=header(sequence, width, height, **more))
    for band in bands(width, height, grey(width, height) if pixels is None else pixels):
        yield v1.StreamRequest(band=band)


def end_of(call) -> tuple[str, str]:
    """Waits for the call's end: its code and its message."""
    try:
        for _ in call:
            pass
        return "OK", ""
    except grpc.RpcError as error:
        return error.code().name, error.details() or ""


def render(address: str, width: int = 64, height: int = 36, settings=None, seconds: float = 20,
           pixels: bytes | None = None) -> tuple[str, str]:
    """How one Render call on a connection of its own ends."""
    with channel(address) as own:
        stub = rpc.RenderServiceStub(own)
        return end_of(stub.Render(render_requests(width, height, settings, pixels), timeout=seconds))


class Bystander:
    """A client that behaves, in a process of its own: bystander.py's session of small frames, five a second."""

    def __init__(self, address: str, *options: str):
        script = pathlib.Path(__file__).with_name("bystander.py")
        self.process = subprocess.Popen([sys.executable, str(script), address, *options], stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE, text=True)
        self.process.stdout.readline()  # its first frame came back

    def result(self) -> dict:
        """Ends it: frames, errors, p50_ms, p99_ms, max_ms. A frame that has no result yet counts with its age."""
        out, _ = self.process.communicate("stop\n", timeout=60)
        return json.loads(out)


@contextlib.contextmanager
def fair_neighbour(address: str, size: str = "1280x720"):
    """A client that streams as fast as it can while the block runs: what any bystander must expect."""
    process = subprocess.Popen([binary("candela"), "bench", "--server", address, "--sessions", "1", "--size", size,
                                "--seconds", "600", "-q"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def beside_fair_neighbour(address: str, seconds: float = 8) -> dict:
    """How a bystander fares beside one fair neighbour: the control of every attack."""
    with fair_neighbour(address):
        time.sleep(1)
        bystander = Bystander(address)
        time.sleep(seconds)
        return bystander.result()


def limit_ms(control: dict, noise_ms: float) -> float:
    """What the bystander's p99 under attack may be: 2 x its p99 beside a fair neighbour, and noise."""
    return 2 * control["p99_ms"] + noise_ms


def expect_unbroken(attacked: dict, what: str) -> None:
    expect(attacked["frames"] > 0 and not attacked["errors"], f"{what}: the bystander's session broke: {attacked}")


def expect_undisturbed(attacked: dict, control: dict, what: str, noise_ms: float = SHORT_NOISE_MS) -> None:
    """The bystander's p99 under attack is within its limit, and its session goes on."""
    limit = limit_ms(control, noise_ms)
    expect_unbroken(attacked, what)
    expect(attacked["p99_ms"] <= limit,
           f"{what}: the bystander's p99 is {attacked['p99_ms']} ms, and {control['p99_ms']} ms beside a fair neighbour; "
           f"{limit:.0f} ms is the limit")
