"""The shapes in which candelad serves, each with an address, its memory, and what went wrong with it."""
import contextlib
import ctypes
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "robustness"))

import harness  # noqa: E402
import podman  # noqa: E402
from podman import attempt, wait_until  # noqa: E402

CLONE_NEWNET = 0x40000000  # of unshare(2)


def resident_mib(pid: int) -> float:
    """Memory of a process and its children; what they share counts once. 0 if it has ended."""
    try:
        rollup = pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        children = pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:  # it has ended
        return 0
    return sum(int(line.split()[1]) for line in rollup if line.startswith("Pss:")) / 1024 + sum(
        resident_mib(int(child)) for child in children)


class Direct:
    """candelad alone on a TCP port, in the open."""

    has_front = False

    def __init__(self, stack: contextlib.ExitStack):
        self.folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="candela-edge-"))
        self.address = self.candelad_listens()
        self.daemon = stack.enter_context(harness.Daemon(listen=self.address))
        self.pids = [self.daemon.pid]

    def candelad_listens(self) -> str:
        return f"127.0.0.1:{harness.free_port()}"

    def from_address(self, number: int) -> tuple[tuple[str, ...], str]:
        """Words before a command that connects from another address than the bystander's, and the address."""
        return (), f"127.0.1.{number}"

    def memory_mib(self) -> float:
        return sum(map(resident_mib, self.pids))

    def front_mib(self) -> float:
        """The front's part of the memory."""
        return 0

    def trouble(self) -> str:
        """Why it is not the process that started, or nothing."""
        return "" if self.daemon.alive() else f"candelad ended with {self.daemon.process.returncode}: {self.daemon.words()[-600:]}"


class Front:
    """deploy/candela-front's nginx before `server`, on `port` of loopback or a free one. Use it as a context manager.

    `settings` are its PROXY_* variables; without a certificate among them it runs in the open.
    """

    def __init__(self, server: str, port: int = 0, **settings: object):
        if not shutil.which("nginx"):
            harness.skip("nginx is not installed; run deploy/install-packages.sh deploy")
        self.port, self.status = port or harness.free_port(), harness.free_port()
        self.address = f"127.0.0.1:{self.port}"
        self.log = tempfile.NamedTemporaryFile(prefix="candela-front-", suffix=".log")
        defaults = {"PROXY_LISTEN": self.address, "PROXY_STATUS": f"127.0.0.1:{self.status}", "PROXY_SERVER": server}
        if "PROXY_CERT" not in settings:
            defaults["PROXY_INSECURE"] = "true"
        # nginx's workers have a user of their own if root starts it.
        path = pathlib.Path(server.removeprefix("unix:"))
        path.parent.chmod(0o755)
        path.chmod(0o777)
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PROXY_")}
        self.process = subprocess.Popen(
            [podman.ROOT / "deploy/candela-front", "--proxy-only"], stderr=self.log, stdin=subprocess.DEVNULL,
            env=clean | defaults | {name: str(value) for name, value in settings.items()})
        self.pid = self.process.pid

    def __enter__(self):
        wait_until(lambda: self.ended() or podman.get(self.status, "/livez")[0] == 200, "nginx answers", self.words, 20)
        harness.expect(not self.ended(), self.trouble())
        return self

    def __exit__(self, *unused):
        self.process.send_signal(signal.SIGQUIT)  # it ends without waiting for candelad
        self.process.wait()
        self.log.close()

    def ended(self) -> bool:
        return self.process.poll() is not None

    def words(self) -> str:
        return pathlib.Path(self.log.name).read_text(errors="replace")

    def trouble(self) -> str:
        return f"the front ended with {self.process.returncode}: {self.words()[-600:]}" if self.ended() else ""


class Processes(Direct):
    """nginx before candelad on a unix socket, both of this machine."""

    has_front = True

    def __init__(self, stack: contextlib.ExitStack, port: int = 0):
        super().__init__(stack)
        self.front = stack.enter_context(Front(self.address, port))
        self.address = self.front.address
        self.pids.append(self.front.pid)

    def candelad_listens(self) -> str:
        return f"unix:{self.folder}/candelad.sock"

    def front_mib(self) -> float:
        return resident_mib(self.front.pid)

    def trouble(self) -> str:
        return self.front.trouble() or super().trouble()


class Firewalled(Processes):
    """The same behind deploy/firewall.nft, in a network that this process and its children have for themselves."""

    def __init__(self, stack: contextlib.ExitStack):
        if not shutil.which("nft"):
            harness.skip("nft is not installed; run deploy/install-packages.sh deploy")
        if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNET) != 0:
            harness.skip(f"a network of its own: {os.strerror(ctypes.get_errno())}")
        podman.run("ip", "link", "set", "lo", "up")
        rules = attempt("nft", "--file", podman.ROOT / "deploy/firewall.nft")
        if "Operation not supported" in rules.stderr or "No such file" in rules.stderr:
            harness.skip(f"the kernel has not all of nft: {rules.stderr}")
        harness.expect(rules.returncode == 0, f"nft refuses deploy/firewall.nft: {rules.stderr}")
        super().__init__(stack, podman.GRPC)


class AsShipped(Direct):
    """The container, with 2 CPUs and 1 GiB. Each attack comes from another container's network."""

    has_front = True

    def __init__(self, stack: contextlib.ExitStack):
        self.stack = stack
        stack.enter_context(podman.prepared())
        if attempt("podman", "image", "exists", podman.IMAGE).returncode != 0:
            harness.skip("there is no image; Container.TheImageBuilds says why")
        [self.container] = stack.enter_context(podman.containers(podman.Container(cpus="2")))
        self.address = f"{self.container.inspect('NetworkSettings.IPAddress')}:{podman.GRPC}"
        self.pid = self.container.inspect("State.Pid")
        self.processes = self.programs()
        self.nginx = min(int(line.split()[0]) for line in self.processes if "nginx" in line)  # the master began first

    def programs(self) -> set[str]:
        """candelad, nginx's master and workers, by their ids."""
        lines = podman.podman("top", self.container.id, "hpid", "comm").splitlines()
        return {line for line in lines if "candelad" in line or "nginx" in line}

    def from_address(self, number: int) -> tuple[tuple[str, ...], str]:
        other = podman.podman("run", "--detach", "--rm", podman.BASE, "sleep", "600")
        self.stack.callback(attempt, "podman", "rm", "--force", "--time=0", other)
        pid = podman.podman("inspect", "--format", "{{.State.Pid}}", other)
        return ("nsenter", f"--target={pid}", "--net"), ""

    def memory_mib(self) -> float:
        return resident_mib(int(self.pid))

    def front_mib(self) -> float:
        return resident_mib(self.nginx)

    def trouble(self) -> str:
        if not self.container.running():
            return f"the container ended with {self.container.exit_code()}: {self.container.log()[-600:]}"
        return "" if self.programs() == self.processes else f"it runs {self.programs()}, and ran {self.processes}"


SHAPES = {"direct": Direct, "processes": Processes, "firewalled": Firewalled, "container": AsShipped}
