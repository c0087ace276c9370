#!/usr/bin/env python3
"""Attacks on HTTP/2 against the shape that is shipped: nginx before candelad. `edge_test.py SHAPE SECONDS BIN [ATTACK...]`

SHAPE is container (the image, as podman runs it), processes (deploy/candela-front's nginx and candelad, both of this
machine) or direct (candelad alone, which fails: gRPC 1.51 has no defence). Each attack lasts SECONDS. BIN contains candela
and candelad. The attacker has an address of its own, and a bystander streams small frames meanwhile. Expected:
- the bystander's p99 is within 2 x of its p99 beside one fair neighbour in the same run, plus 200 ms of noise;
- no process ends or restarts, and health is good afterwards;
- the memory comes back.
"""
import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "robustness"))
os.environ["CANDELA_BIN"] = sys.argv[3] if len(sys.argv) > 3 else ""

import attacks  # noqa: E402
import harness  # noqa: E402
import podman  # noqa: E402
from harness import expect, report  # noqa: E402
from podman import attempt, run, wait_until  # noqa: E402

LIMIT_MIB = 1024  # of the shape's memory
KEPT_MIB = 96  # that may stay with allocators after an attack


def resident_mib(pid: int) -> float:
    """Memory of a process and its children; what they share counts once."""
    try:
        rollup = pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        children = pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:  # it has ended
        return 0
    return sum(int(line.split()[1]) for line in rollup if line.startswith("Pss:")) / 1024 + sum(
        resident_mib(int(child)) for child in children)


class Direct:
    """candelad alone on a TCP port, in the open."""

    def __init__(self, stack: contextlib.ExitStack):
        self.address = f"127.0.0.1:{harness.free_port()}"
        self.folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="candela-edge-"))
        self.daemon = stack.enter_context(harness.Daemon(listen=self.candelad_listens()))
        self.pids = [self.daemon.pid]

    def candelad_listens(self) -> str:
        return self.address

    def from_address(self, number: int) -> tuple[tuple[str, ...], str]:
        """Words before a command that connects from another address than the bystander's, and the address."""
        return (), f"127.0.1.{number}"

    def memory_mib(self) -> float:
        return sum(map(resident_mib, self.pids))

    def trouble(self) -> str:
        """Why it is not the process that started, or nothing."""
        return "" if self.daemon.alive() else f"candelad ended with {self.daemon.process.returncode}: {self.daemon.words()[-600:]}"


class Processes(Direct):
    """deploy/candela-front's nginx before candelad on a unix socket."""

    def __init__(self, stack: contextlib.ExitStack):
        super().__init__(stack)
        status = f"127.0.0.1:{harness.free_port()}"
        settings = {"PROXY_INSECURE": "true", "PROXY_LISTEN": self.address, "PROXY_STATUS": status,
                    "PROXY_SERVER": self.candelad_listens()}
        self.proxy = subprocess.Popen([podman.ROOT / "deploy/candela-front", "--proxy-only"], env=os.environ | settings)
        stack.callback(self.proxy.wait)
        stack.callback(self.daemon.process.terminate)  # the front follows it
        stack.callback(self.proxy.terminate)
        # nginx's workers have a user of their own if root starts it.
        pathlib.Path(self.folder).chmod(0o755)
        pathlib.Path(self.candelad_listens().removeprefix("unix:")).chmod(0o777)
        self.pids.append(self.proxy.pid)

    def candelad_listens(self) -> str:
        return f"unix:{self.folder}/candelad.sock"

    def trouble(self) -> str:
        return f"the front ended with {self.proxy.returncode}" if self.proxy.poll() is not None else super().trouble()


class AsShipped(Direct):
    """The container, with 2 CPUs and 1 GiB. Each attack comes from another container's network."""

    def __init__(self, stack: contextlib.ExitStack):
        self.stack = stack
        stack.enter_context(podman.prepared())
        if attempt("podman", "image", "exists", podman.IMAGE).returncode != 0:
            harness.skip("there is no image; Container.TheImageBuilds says why")
        [self.container] = stack.enter_context(podman.containers(podman.Container(cpus="2")))
        self.address = f"{self.container.inspect('NetworkSettings.IPAddress')}:{podman.GRPC}"
        self.pid = self.container.inspect("State.Pid")
        self.processes = self.programs()

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

    def trouble(self) -> str:
        if not self.container.running():
            return f"the container ended with {self.container.exit_code()}: {self.container.log()[-600:]}"
        return "" if self.programs() == self.processes else f"it runs {self.programs()}, and ran {self.processes}"


SHAPES = {"direct": Direct, "processes": Processes, "container": AsShipped}


class Memory(threading.Thread):
    """Follows the shape's memory; `peak` is in MiB."""

    def __init__(self, shape):
        super().__init__(daemon=True)
        self.shape, self.peak, self.over = shape, 0.0, threading.Event()
        self.start()

    def run(self) -> None:
        while not self.over.wait(0.2):
            self.peak = max(self.peak, self.shape.memory_mib())


def attack(shape, name: str, seconds: float) -> tuple[dict, dict, float]:
    """What the attacker and the bystander say, and the most memory in MiB."""
    bystander, memory = harness.Bystander(shape.address), Memory(shape)
    prefix, source = shape.from_address(1 + list(attacks.ATTACKS).index(name))
    attacker = attempt(*prefix, sys.executable, HERE / "attacks.py", name, shape.address, seconds, source, timeout=seconds + 60)
    if attacker.returncode == harness.SKIPPED:
        harness.skip(attacker.stdout.strip())
    memory.over.set()
    memory.join()
    fared = bystander.result()
    expect(attacker.returncode == 0, f"the attack {name} did not run: {attacker.stderr}")
    return json.loads(attacker.stdout), fared, memory.peak


def healthy(shape) -> bool:
    return attempt(harness.binary("candela"), "health", "--server", shape.address).returncode == 0


def check(shape, name: str, seconds: float, control: dict) -> None:
    before = shape.memory_mib()
    did, fared, peak = attack(shape, name, seconds)
    report(attack=name, did=did, bystander=fared, mib_before=round(before), mib_at_most=round(peak))
    expect(did["connections"] > 0, f"{name}: no connection was made, so nothing was attacked")
    expect(not shape.trouble(), f"{name}: {shape.trouble()}")
    harness.expect_undisturbed(fared, control, name)
    expect(peak < LIMIT_MIB, f"{name}: {peak:.0f} MiB were in use, of {LIMIT_MIB}")
    wait_until(lambda: healthy(shape), f"health is good after {name}", seconds=20)
    wait_until(lambda: shape.memory_mib() < before + KEPT_MIB, f"the memory is back after {name}",
               lambda: f"{before:.0f} MiB before, {shape.memory_mib():.0f} MiB after", 30, 0.5)


def main() -> None:
    shape_name, seconds = sys.argv[1], float(sys.argv[2])
    with contextlib.ExitStack() as stack:
        shape = SHAPES[shape_name](stack)
        wait_until(lambda: healthy(shape), "it serves", seconds=60)
        control = harness.beside_fair_neighbour(shape.address, max(seconds, 6))
        report(beside_fair_neighbour=control)
        start = shape.memory_mib()
        for name in sys.argv[4:] or attacks.ATTACKS:
            check(shape, name, seconds, control)
        report(mib_at_start=round(start), mib_at_end=round(shape.memory_mib()))


if __name__ == "__main__":
    main()
