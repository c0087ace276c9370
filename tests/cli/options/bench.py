"""A workbench for the option table: scenes, certificates, daemons, and runs of the command."""
import contextlib
import functools
import hashlib
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import threading

from exr import write_exr

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "tests/net"))
sys.path.insert(0, str(ROOT / "tests/robustness"))
from harness import Daemon, binary, end_of, expect, render, render_requests, rpc, v1, wait_until  # noqa: E402
from scenes import NAN, write_pfm, write_png  # noqa: E402

DAEMON = "candelad"
# Times and names differ from run to run; everything else of a command's JSON is its result.
UNSTEADY = ("_ms", "seconds", "server", "device", "output", "plan", "frames_per_second", "per_session", "window_fps",
            "files")


class Run:
    """One run of the command: its exit code, what it printed, and every file that it wrote, by name."""

    def __init__(self, code: int, out: str, err: str, folder: pathlib.Path):
        self.code, self.out, self.err = code, out, err
        self.files = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}

    def lines(self) -> list[dict]:
        return [json.loads(line) for line in self.out.splitlines() if line.startswith("{")]

    def result(self) -> str:
        """A digest of images and numbers, without times."""
        steady = [{key: value for key, value in line.items() if not any(word in key for word in UNSTEADY)}
                  for line in self.lines()]
        parts = [json.dumps(steady)] + [f"{name} {hashlib.sha256(data).hexdigest()}" for name, data in self.files.items()
                                        if name != "numbers.json"]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class Bench:
    """Everything is in `folder`, which is the commands' working directory. Use it as a context manager."""

    def __init__(self, folder: pathlib.Path):
        self.folder = folder
        self.runs = 0
        self.ends = contextlib.ExitStack()
        # Without the variables that change what a command does.
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith(("CANDELA", "OCIO"))}

    def __enter__(self):
        self._make_scenes()
        self._make_certificates()
        return self

    def __exit__(self, *unused):
        self.ends.close()

    @functools.cached_property
    def plain(self) -> Daemon:
        return self._daemon()

    @functools.cached_property
    def told(self) -> Daemon:
        """One that logs, with metrics."""
        return self.ends.enter_context(Daemon())

    @functools.cached_property
    def full(self) -> Daemon:
        """One whose only session and only call are taken."""
        full, over = self._daemon("--max-sessions", "1", "--max-calls", "1", "--idle-timeout", "1h"), threading.Event()

        def session():
            yield v1.StreamRequest(open=v1.StreamOpen(session="full"))
            over.wait()

        def call():
            yield next(render_requests(8, 8))
            over.wait()

        channel = full.channel()
        stub = rpc.RenderServiceStub(channel)

        def hold(begin, requests) -> None:
            while not over.is_set():  # again if somebody else had the place
                end_of(begin(requests()))

        holders = [threading.Thread(target=hold, args=place) for place in ((stub.Stream, session), (stub.Render, call))]
        self.ends.callback(channel.close)
        for holder in holders:
            holder.start()
            self.ends.callback(holder.join)
        self.ends.callback(over.set)  # comes first
        expect(wait_until(lambda: render(full.address)[0] == "UNAVAILABLE", 20), "no call fills the full server")
        return full

    @functools.cached_property
    def guarded(self) -> Daemon:
        return self._daemon("--tls-cert", self._in("server.pem"), "--tls-key", self._in("server.key"),
                            "--tls-client-ca", self._in("ca.pem"), "--token-file", self._in("tokens"))

    @functools.cached_property
    def public(self) -> Daemon:
        return self._daemon("--tls-cert", self._in("server.pem"), "--tls-key", self._in("server.key"))

    def _in(self, name: str) -> str:
        return str(self.folder / name)

    def _daemon(self, *options: str) -> Daemon:
        return self.ends.enter_context(Daemon(*options, "--log-level", "off", metrics=False))

    def _make_scenes(self) -> None:
        self("sample scene.exr --size 96x64 -q")
        self("sample --panorama pano.exr --size 128x64 -q")
        (self.folder / "keys.json").write_text('{"keys": [{"time": 0}, {"time": 1, "yaw": 90}]}')
        self("sample --sequence film --size 48x32 --frames 6 -q")
        write_pfm(self.folder / "nan.pfm", 4, 4, [NAN] + [0.25 * i for i in range(47)])
        write_pfm(self.folder / "whole.pfm", 4, 4, [0.25 * i for i in range(48)])
        (self.folder / "cut.pfm").write_bytes((self.folder / "whole.pfm").read_bytes()[:-60])
        write_pfm(self.folder / "rows.0001.pfm", 8, 4, [0.1 * (1 + i // 24) ** 3 for i in range(96)])
        write_png(self.folder / "codes.0001.png", 8, 4, [0x2000 * (1 + i % 7) for i in range(96)], (9, 18, 0, 1))
        self("render scene.exr matrix.0001.avif -q")
        self("render scene.exr map.0001.jpg --gain-map 1000 -q")
        grey = {name: (lambda x, y: 0.1 + 0.05 * x) for name in "RGB"}
        red = {"R": lambda x, y: 2.0, "G": lambda x, y: 0.1, "B": lambda x, y: 0.1}
        half = {"A": lambda x, y: 0.25 * (x % 5)}
        lit = {name: (lambda x, y, value=value: value(x, y) if x % 5 else 0.0) for name, value in red.items()}
        write_exr(self.folder / "alpha.exr", 16, 12, {"channels": lit | half})
        write_exr(self.folder / "layers.exr", 16, 12, {"channels": grey | {f"key.{n}": v for n, v in red.items()}})
        write_exr(self.folder / "chunk.exr", 1024, 1, {"channels": {f"k{i}.Y": lambda x, y: 0.5 for i in range(600)}})
        write_exr(self.folder / "parts.exr", 16, 12, {"name": "beauty", "channels": grey}, {"name": "sun", "channels": red})
        write_exr(self.folder / "views.exr", 16, 12,
                  {"channels": grey | {f"right.{n}": v for n, v in red.items()}, "views": ["left", "right"]})
        write_exr(self.folder / "wide.exr", 16, 12, {"channels": grey, "aspect": 2})
        for name in ("layers", "parts", "views", "alpha", "wide"):  # sequences of one frame
            (self.folder / f"{name}.0001.exr").symlink_to(f"{name}.exr")
        (self.folder / "gap").mkdir()
        for number in (0, 1, 3, 4):
            (self.folder / f"gap/{number:04d}.exr").symlink_to(f"../film/{number:04d}.exr")
        (self.folder / "broken").mkdir()
        for number in (0, 2):
            (self.folder / f"broken/{number:04d}.exr").symlink_to(f"../film/{number:04d}.exr")
        (self.folder / "broken/0001.exr").write_bytes(b"v/1\1 no picture")
        (self.folder / "studio.ocio").write_text(OCIO)
        (self.folder / "look.cube").write_text(LUT)
        self("meter film --save-exposures shot.json -q")
        self("meter film --range 0-2 --save-exposures begun.json -q")

    def _make_certificates(self) -> None:
        """A CA, a server that is only called candela.test, a client, and the token of the guarded daemon."""
        def openssl(line: str) -> None:
            subprocess.run(["openssl", *shlex.split(line)], cwd=self.folder, check=True, stdout=subprocess.DEVNULL,
                           stderr=subprocess.DEVNULL, timeout=60)
        key = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
        openssl(f"req -x509 {key} -days 2 -subj /CN=ca -keyout ca.key -out ca.pem")
        for name in ("server", "client"):
            openssl(f"req {key} -subj /CN={name} -keyout {name}.key -out {name}.csr")
            (self.folder / f"{name}.ext").write_text("subjectAltName=DNS:candela.test\n")
            openssl(f"x509 -req -days 2 -CA ca.pem -CAkey ca.key -CAcreateserial -extfile {name}.ext -in {name}.csr "
                    f"-out {name}.pem")
        (self.folder / "tokens").write_text("0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef\n")
        for name in ("server.key", "client.key", "tokens"):
            (self.folder / name).chmod(0o600)

    def __call__(self, line: str, seconds: float = 300) -> Run:
        """Runs `candela LINE`. In it OUT stands for a folder of this run, PLAIN, GUARDED, PUBLIC, TOLD and FULL for daemons."""
        self.runs += 1
        out = self.folder / f"out-{self.runs}"
        out.mkdir()
        line = re.sub(r"\bOUT\b", out.name, line)
        for name in ("plain", "guarded", "public", "told", "full"):
            line = re.sub(rf"\b{name.upper()}\b", lambda _, name=name: getattr(self, name).address, line)
        done = subprocess.run([binary("candela"), *shlex.split(line)], cwd=self.folder, stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace", timeout=seconds,
                              env=self.environment)
        return Run(done.returncode, done.stdout, done.stderr.replace(out.name, "OUT"), out)

    @functools.cache
    def help(self, command: str) -> str:
        if command == DAEMON:
            return subprocess.run([binary(DAEMON), "--help"], stdout=subprocess.PIPE, text=True, timeout=60, check=True).stdout
        return self(f"{command} --help").out

    def options(self, command: str) -> set[str]:
        return set(re.findall(r"^  (?:-\w,)?(--[a-z][a-z0-9-]*)", self.help(command), re.M))

    def words(self, command: str, option: str) -> list[str]:
        """The choices that the help lists, as in "...: one, two (note), three (default one)"."""
        line = re.search(rf"^  {option} .*", self.help(command), re.M).group()
        listed = re.sub(r"\([^()]*\)", "", line).rsplit(":", 1)[1].split(", or ")[0]
        return [word.strip() for word in listed.split(",")]


# A cube of two points a side, which shows values as they are, but red and blue exchanged.
LUT = "LUT_3D_SIZE 2\n" + "".join(f"{b} {g} {r}\n" for b in (0, 1) for g in (0, 1) for r in (0, 1))
OCIO = """\
ocio_profile_version: 2
roles: {scene_linear: Linear, default: Linear, aces_interchange: ACES2065-1, cie_xyz_d65_interchange: XYZ}
file_rules:
  - !<Rule> {name: Default, colorspace: default}
displays:
  Monitor:
    - !<View> {name: Plain, colorspace: Screen}
    - !<View> {name: Dark, colorspace: Dim}
  Projector:
    - !<View> {name: Plain, colorspace: Dim}
colorspaces:
  - !<ColorSpace> {name: XYZ, isdata: false}
  - !<ColorSpace>
    name: ACES2065-1
  - !<ColorSpace>
    name: Linear
    to_scene_reference: !<MatrixTransform> {matrix: [0.4396, 0.3830, 0.1774, 0, 0.0898, 0.8134, 0.0968, 0, 0.0175, 0.1116, 0.8709, 0, 0, 0, 0, 1]}
  - !<ColorSpace>
    name: Other
    to_scene_reference: !<MatrixTransform> {matrix: [0.3, 0.3, 0.3, 0, 0.1, 0.8, 0.1, 0, 0.1, 0.1, 0.8, 0, 0, 0, 0, 1]}
  - !<ColorSpace>
    name: Screen
    from_scene_reference: !<ExponentTransform> {value: [0.4545, 0.4545, 0.4545, 1]}
  - !<ColorSpace>
    name: Dim
    from_scene_reference: !<ExponentTransform> {value: [0.8, 0.8, 0.8, 1]}
"""
