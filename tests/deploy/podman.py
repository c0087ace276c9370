"""Helpers for the deployment tests: podman with its own storage, this tree's image, and containers that run as shipped.

Needs root. CANDELA_DEPLOY_CACHE (/var/tmp/candela-deploy) keeps the base image and podman's layers between runs.
"""
import contextlib
import fcntl
import hashlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable

ROOT = pathlib.Path(__file__).resolve().parents[2]
CACHE = pathlib.Path(os.environ.get("CANDELA_DEPLOY_CACHE", "/var/tmp/candela-deploy"))
IMAGE = f"localhost/candela:test-{hashlib.sha256(str(ROOT).encode()).hexdigest()[:12]}"
GPU_IMAGE = f"{IMAGE}-gpu"
HOST_IMAGE = f"{IMAGE}-host"
BASE = "docker.io/library/debian:bookworm-slim"
BASE_DAYS = 7  # after this many days it is rebuilt, with every layer
SKIPPED = 77
# The options that deploy/Containerfile recommends.
AS_SHIPPED = ("--read-only", "--read-only-tmpfs=false", "--tmpfs=/tmp:size=16m", "--cap-drop=ALL",
              "--security-opt=no-new-privileges")
KEYS = "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n"
GRPC, METRICS = 50051, 9464

CONTAINERS_CONF = """\
[containers]
default_ulimits = ["nofile=20000:20000", "nproc=32768:32768"]
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
[network]
network_config_dir = "{cache}/networks"
"""
STORAGE_CONF = """\
[storage]
driver = "overlay"
graphroot = "{cache}/storage"
runroot = "{cache}/run"
"""


def skip(reason: str) -> None:
    print(f"skipped: {reason}")
    sys.exit(SKIPPED)


def fail(message: str) -> None:
    raise SystemExit(f"failed: {message}")


def expect(true: object, message: str) -> None:
    if not true:
        fail(message)


def run(*command: object, timeout: float = 300) -> str:
    """Returns what the command prints. If it fails, the test fails and shows its output."""
    done = attempt(*command, timeout=timeout)
    if done.returncode != 0:
        fail(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


def attempt(*command: object, timeout: float = 300) -> subprocess.CompletedProcess[str]:
    words = [str(word) for word in command]
    try:
        return subprocess.run(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                              timeout=timeout, cwd=CACHE if CACHE.is_dir() else None)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(words, 124, "", f"it did not end within {timeout:.0f} s")


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    return (done.stderr.strip().splitlines() or [f"it ended with {done.returncode}"])[-1]


def podman(*arguments: object, timeout: float = 300) -> str:
    return run("podman", *arguments, timeout=timeout)


@contextlib.contextmanager
def prepared():
    """Sets podman's environment and locks podman for this test. Skips the test if podman cannot work here."""
    if os.geteuid() != 0:
        skip("containers need root here; run it as root")
    missing = [tool for tool in ("podman", "runc", "mmdebstrap", "catatonit", "haproxy") if not shutil.which(tool)]
    if missing:
        skip(f"{', '.join(missing)} is not installed; run deploy/install-packages.sh deploy")
    (CACHE / "networks").mkdir(parents=True, exist_ok=True)
    with open(CACHE / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for name, text in (("CONTAINERS_CONF", CONTAINERS_CONF), ("CONTAINERS_STORAGE_CONF", STORAGE_CONF)):
            os.environ[name] = str(CACHE / name.lower())
            (CACHE / name.lower()).write_text(text.format(cache=CACHE))
        info = attempt("podman", "info")
        if info.returncode != 0:
            skip(f"podman does not work here: {last_line(info)}")
        yield


def make_base() -> None:
    """Makes the Containerfile's base image from this machine's package mirror, like Debian's slim image."""
    image = attempt("podman", "image", "inspect", "--format", "{{.Created.Unix}}", BASE)
    if image.returncode == 0 and time.time() - int(image.stdout) < BASE_DAYS * 86400:
        return
    sources = next((path for path in map(pathlib.Path, ("/etc/apt/sources.list.d/debian.sources", "/etc/apt/sources.list"))
                    if path.exists()), None)
    expect(sources, "neither /etc/apt/sources.list.d/debian.sources nor /etc/apt/sources.list says where packages are")
    slim = ["path-exclude=/usr/share/doc/*", "path-include=/usr/share/doc/*/copyright", "path-exclude=/usr/share/man/*",
            "path-exclude=/usr/share/info/*", "path-exclude=/usr/share/locale/*"]
    tar = CACHE / "base.tar"
    made = attempt("mmdebstrap", "--variant=minbase", "--include=ca-certificates,usr-is-merged",
                   "--hook-dir=/usr/share/mmdebstrap/hooks/merged-usr", *(f"--dpkgopt={option}" for option in slim), "bookworm",
                   tar, sources, timeout=900)
    if made.returncode != 0:
        skip(f"mmdebstrap cannot make a base image here: {last_line(made)}")
    podman("import", tar, BASE)
    tar.unlink()


def try_podman() -> None:
    """Skips the test unless a container with limits and a network runs."""
    ran = attempt("podman", "run", "--rm", "--cpus=1", "--memory=64m", "--memory-swap=64m",
                  f"--publish=127.0.0.1:{free_port()}:{GRPC}", BASE, "true")
    if ran.returncode != 0:
        skip(f"podman cannot run a container here: {last_line(ran)}")


def expect_package_mirror() -> None:
    """Skips the test unless a container reaches the package mirror that images are built from."""
    asked = attempt("podman", "run", "--rm", "--network=host", BASE, "apt-get", "--option=APT::Update::Error-Mode=any",
                    "--option=Acquire::Retries=0", "--option=Acquire::http::Timeout=20", "update")
    if asked.returncode != 0:
        skip(f"a container reaches no package mirror here: {last_line(asked)}")


def build(tag: str, file: pathlib.Path, context: pathlib.Path, *options: str) -> None:
    """Builds an image on the local base images, with packages from this machine's mirror."""
    podman("build", "--pull=never", "--network=host", "--format=docker", f"--tag={tag}", f"--file={file}", *options, context,
           timeout=2400)


def build_gpu_image(version: str) -> None:
    """The image with all of Mesa's drivers, beside the shipped one."""
    build(GPU_IMAGE, ROOT / "deploy/Containerfile", ROOT, f"--build-arg=VERSION={version}", "--build-arg=DRIVERS=mesa")


def build_host_image(version: str) -> None:
    """The image without Vulkan."""
    build(HOST_IMAGE, ROOT / "deploy/Containerfile", ROOT, f"--build-arg=VERSION={version}", "--build-arg=DEVICE=host")


# How deploy/Containerfile makes the programs, and how it takes those that are made already.
COMPILED = """RUN deploy/build.sh release -DCANDELA_TESTS=OFF \\
 && install -s -D -t /opt/bin build/release/bin/candela build/release/bin/candelad \\
"""
COPIED = """COPY --from=programs candela candelad /tmp/programs/
RUN install -s -D -t /opt/bin /tmp/programs/candela /tmp/programs/candelad \\
"""


def build_image(version: str, programs: pathlib.Path | None) -> None:
    """As shipped, or with the programs of that folder, which save the time to compile them again."""
    attempt("podman", "untag", IMAGE)  # so that no test uses an image of an older tree
    make_base()
    try_podman()
    expect_package_mirror()
    file, options = ROOT / "deploy/Containerfile", [f"--build-arg=VERSION={version}"]
    if programs:
        text = file.read_text()
        expect(text.count(COMPILED) == 1, "deploy/Containerfile makes the programs in another way")
        file = CACHE / "containerfile"
        file.write_text(text.replace(COMPILED, COPIED))
        options.append(f"--build-context=programs={programs}")
    build(IMAGE, file, ROOT, *options)
    podman("image", "prune", "--force", f"--filter=until={BASE_DAYS * 24}h")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def wait_until(done: Callable[[], bool], what: str, why: Callable[[], str] = str, seconds: float = 120,
               every: float = 0.1) -> None:
    """Waits until `done` returns true. If that takes too long, fails and shows what `why` returns."""
    limit = time.monotonic() + seconds
    while not done():
        if time.monotonic() > limit:
            fail(f"not within {seconds:.0f} s: {what}\n{why()}")
        time.sleep(every)


def get(port: int, path: str) -> tuple[int, str]:
    """Returns the status and the body; the status is 0 if nobody answers."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=5) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()
    except OSError:
        return 0, ""


class Container:
    """candelad as shipped, with 1 CPU and 1 GB, on ports of 127.0.0.1 that it keeps when it is restarted."""

    def __init__(self, *arguments: str, options: tuple[str, ...] = (), cpus: str = "1"):
        self.port, self.metrics_port = free_port(), free_port()
        self.address = f"127.0.0.1:{self.port}"
        self.id = podman("create", *AS_SHIPPED, f"--cpus={cpus}", "--memory=1g", "--memory-swap=1g",
                         f"--publish=127.0.0.1:{self.port}:{GRPC}", f"--publish=127.0.0.1:{self.metrics_port}:{METRICS}",
                         "--env=PROXY_INSECURE=true", *options, IMAGE, "--insecure", f"--metrics=0.0.0.0:{METRICS}", *arguments)

    def start(self) -> "Container":
        podman("start", self.id)
        wait_until(self.ready_or_dead, "a container serves")
        expect(self.running(), f"the container ended with {self.exit_code()}:\n{self.log()}")
        return self

    def ready_or_dead(self) -> bool:
        return get(self.metrics_port, "/readyz")[0] == 200 or not self.running()

    def inspect(self, field: str) -> str:
        return podman("inspect", "--format", "{{." + field + "}}", self.id)

    def running(self) -> bool:
        return self.inspect("State.Running") == "true"

    def exit_code(self) -> int:
        return int(self.inspect("State.ExitCode"))

    def log(self) -> str:
        logs = attempt("podman", "logs", self.id)
        return logs.stdout + logs.stderr

    def metric(self, name: str) -> float:
        status, text = get(self.metrics_port, "/metrics")
        values = [line.rsplit(" ", 1)[1] for line in text.splitlines() if line.startswith(name)]
        expect(status == 200 and values, f"/metrics says {status} and has no {name}")
        return sum(map(float, values))

    def stop(self) -> None:
        podman("stop", "--time=60", self.id)

    def kill(self) -> None:
        """Sends SIGKILL to the daemon and its init, without podman."""
        os.kill(int(self.inspect("State.Pid")), signal.SIGKILL)

    def remove(self) -> None:
        attempt("podman", "rm", "--force", "--time=1", self.id)


@contextlib.contextmanager
def containers(*those: Container):
    """Starts the containers, and removes them at the end."""
    try:
        yield [container.start() for container in those]
    finally:
        for container in those:
            container.remove()


@contextlib.contextmanager
def process(*command: object):
    """Runs a process during the test. Prints its output if the test fails."""
    running = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield running
    except SystemExit:
        running.kill()
        print(running.stdout.read())
        raise
    finally:
        running.kill()
        running.wait()
