"""More connections than there are file descriptors, and than --max-connections: the server never becomes deaf.

    descriptors_test.py [NAME...]      # all, or the named functions
"""
import contextlib
import os
import resource
import socket
import subprocess
import sys
import time

os.environ["GRPC_ENABLE_FORK_SUPPORT"] = "false"  # a child that only sets limits and starts another program needs none
import harness  # noqa: E402
import http2  # noqa: E402
from harness import Bystander, Daemon, binary, expect, report  # noqa: E402


def connect(address: str, count: int) -> list[http2.Connection]:
    connections = []
    for _ in range(count):
        with contextlib.suppress(OSError):
            connections.append(http2.Connection(address, unread=True))
    return connections


def cpu_seconds(pid: int) -> float:
    fields = open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100


def attack(daemon: Daemon, count: int, reason: str) -> None:
    bystander = Bystander(daemon.address)
    connections = connect(daemon.address, count)
    time.sleep(1)
    before = cpu_seconds(daemon.pid)
    time.sleep(2)
    idle = cpu_seconds(daemon.pid) - before
    refused = daemon.series("candela_connections_refused_total")
    open_now = daemon.series("candela_connections").get("", -1)
    probes = {path: daemon.get(path)[0] for path in ("/readyz", "/livez")}
    for connection in connections:
        connection.close()
    time.sleep(1)
    after = daemon.series("candela_connections").get("", -1)
    answer = harness.render(daemon.address)
    health = subprocess.run([binary("candela"), "health", "--server", daemon.address], capture_output=True, text=True, timeout=60)
    result = bystander.result()
    report(attack=reason, connections=len(connections), open=open_now, refused=refused, cpu_of_2_s=round(idle, 2), probes=probes,
           open_afterwards=after, render=answer, bystander=result)
    expect(daemon.alive(), "it ended")
    expect(answer[0] == "OK", f"a render afterwards: {answer}")
    expect(health.returncode == 0, f"candela health afterwards: {health.stderr}")
    expect(probes == {"/readyz": 200, "/livez": 200}, f"probes during the attack: {probes}")
    expect(refused.get(f'reason="{reason}"', 0) > 0, f"no connection is counted as refused: {refused}")
    expect(idle < 1, f"it used {idle} s of CPU in 2 s without being able to accept")
    expect(result["frames"] > 0 and not result["errors"], f"the bystander's session broke: {result}")
    expect(after <= 2, f"{after} connections count as open after all of them were closed")


def low_limit() -> None:
    """The hard limit is 64 files: the server takes as many connections as fit."""
    with Daemon("--idle-timeout", "5s", preexec=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))) as daemon:
        attack(daemon, 120, "limit")
        expect(daemon.stop() == 0, "it did not end with 0")


def given_limit() -> None:
    with Daemon("--max-connections", "10") as daemon:
        attack(daemon, 60, "limit")
        lines = [line for line in daemon.words().splitlines() if "connection refused" in line]
        expect(0 < len(lines) < 10, f"{len(lines)} lines for 50 refused connections")
        expect(daemon.stop() == 0, "it did not end with 0")


def no_descriptor_left() -> None:
    """The limit falls while it runs, as when another part of the process took the descriptors."""
    with Daemon() as daemon:
        used = max(int(path) for path in os.listdir(f"/proc/{daemon.pid}/fd"))
        bystander = Bystander(daemon.address)
        probe = socket.create_connection(("127.0.0.1", int(daemon.metrics.rsplit(":", 1)[1])))
        resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE, (used + 2, 4096))
        connections = connect(daemon.address, 60)
        time.sleep(1)
        before = cpu_seconds(daemon.pid)
        time.sleep(2)
        idle = cpu_seconds(daemon.pid) - before
        for connection in connections:
            connection.close()
        resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE, (4096, 4096))
        probe.close()
        time.sleep(1)
        answer, result = harness.render(daemon.address), bystander.result()
        refused = daemon.series("candela_connections_refused_total")
        report(attack="descriptors", refused=refused, cpu_of_2_s=round(idle, 2), render=answer, bystander=result)
        expect(answer[0] == "OK", f"a render afterwards: {answer}")
        expect(refused.get('reason="descriptors"', 0) > 0, f"no connection is counted as refused: {refused}")
        expect(idle < 1, f"it used {idle} s of CPU in 2 s without being able to accept")
        expect(result["frames"] > 0 and not result["errors"], f"the bystander's session broke: {result}")


def soft_limit() -> None:
    """The soft limit is raised to the hard one, and `limits` says what came of it."""
    with Daemon(preexec=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 512))) as daemon:
        limit = resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE)
        expect(limit == (512, 512), f"its limits of open files are {limit}")
        expect("descriptors=512" in daemon.words(), "no line says the limit")
        expect(daemon.stop() == 0, "it did not end with 0")


def idle_connections_end() -> None:
    """A connection without a call ends after five idle timeouts, ten seconds at least; a session's goes on."""
    with Daemon("--idle-timeout", "2s") as daemon:
        bystander = Bystander(daemon.address)
        connection = http2.Connection(daemon.address, unread=True)
        connection.socket.settimeout(25)
        begin, ended = time.monotonic(), False
        with contextlib.suppress(TimeoutError):
            while connection.socket.recv(1000):
                pass
            ended = True
        seconds = time.monotonic() - begin
        result = bystander.result()
        report(attack="idle", ended=ended, seconds=round(seconds, 1), bystander=result)
        expect(ended, "an idle connection is kept for ever")
        expect(seconds > 5, f"an idle connection was ended after {seconds} s")
        expect(result["frames"] > 0 and not result["errors"], f"the bystander's session broke: {result}")


for attempt in (soft_limit, low_limit, given_limit, no_descriptor_left, idle_connections_end):
    if len(sys.argv) < 2 or attempt.__name__ in sys.argv:
        attempt()
