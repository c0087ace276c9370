#!/usr/bin/env python3
"""Measures how many streams one core handles, and how much a second core adds: scaling.py BIN [SECONDS]

Needs two idle cores, 0 and 1, but no root. BIN contains candela and candelad. Each measurement takes SECONDS (20).

The load has to run on the same cores:
- Streams of 1280x720 at 24 per second: candelad runs alone on core 0, the load on core 1.
- One replica and two: each replica has a core, and its load runs on that core too. Replicas share only memory and its
  bandwidth, so the throughput of two can be compared with that of one. The CPU seconds per frame of the replicas
  themselves tell what a core could do without the load.
- HAProxy, if installed: its CPU seconds per frame and per gigabyte. candelad runs on core 0, all else on core 1.
"""
import contextlib
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

from podman import free_port

SIZE, FPS = "1280x720", 24
FRAME_BYTES = 1280 * 720 * (8 + 4)  # halves in, bytes out
DELIVERED = 0.995  # this share of the frames due counts as all
TICKS = os.sysconf("SC_CLK_TCK")


def on_core(core: int, *command: str) -> list[str]:
    return ["taskset", "--cpu-list", str(core), *command]


def cpu_seconds(pid: int) -> float:
    user, system = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[11:13]
    return (int(user) + int(system)) / TICKS


@contextlib.contextmanager
def replica(core: int):
    """Runs candelad on one core, with the threads that a quota of one CPU would give it. Yields its process and address."""
    with subprocess.Popen(on_core(core, f"{BIN}/candelad", "--listen", "127.0.0.1:0", "--log-level", "off"),
                          env={**os.environ, "LP_NUM_THREADS": "1"}, stdout=subprocess.PIPE, text=True) as process:
        try:
            line = process.stdout.readline()
            if not line.startswith("listening on "):
                raise SystemExit(f"{BIN}/candelad does not start; run it by hand to see why")
            yield process, line.split()[-1]
        finally:
            process.terminate()


def load(core: int, address: str, sessions: int, fps: str) -> subprocess.Popen:
    return subprocess.Popen(on_core(core, f"{BIN}/candela", "bench", "--server", address, "--sessions", str(sessions), "--size",
                                    SIZE, "--fps", fps, "--seconds", str(SECONDS), "--json", "-", "-q"),
                            stdout=subprocess.PIPE, text=True)


def figures(bench: subprocess.Popen) -> dict:
    out = bench.communicate(timeout=SECONDS + 300)[0]
    if bench.returncode != 0:
        raise SystemExit(f"candela bench ended with {bench.returncode}")
    return json.loads(out)


def streams_per_core() -> None:
    carried, sessions = 0, 1
    while True:
        with replica(0) as (process, address):
            before = cpu_seconds(process.pid)
            result = figures(load(1, address, sessions, str(FPS)))
            share = (cpu_seconds(process.pid) - before) / result["frames"] * result["frames_per_second"]
        done = result["frames"] / (sessions * FPS * result["seconds"])
        print(f"{sessions} streams of {SIZE} at {FPS} per second: {done:.1%} of the frames, p99 {result['latency_ms']['p99']:.0f} ms, "
              f"{share:.0%} of a core")
        if done < DELIVERED:
            break
        carried, sessions = sessions, sessions + 1
    print(f"streams per core: {carried}\n")


def throughput(cores: list[int]) -> float:
    """Frames per second of all replicas together, one on each core."""
    with contextlib.ExitStack() as stack:
        replicas = [stack.enter_context(replica(core)) for core in cores]
        before = [cpu_seconds(process.pid) for process, _ in replicas]
        benches = [load(core, address, 2, "max") for core, (_, address) in zip(cores, replicas)]
        results = [figures(bench) for bench in benches]
        spent = sum(cpu_seconds(process.pid) for process, _ in replicas) - sum(before)
    frames, rate = sum(result["frames"] for result in results), sum(result["frames_per_second"] for result in results)
    print(f"cores {cores}: {rate:.1f} frames per second in all; {1000 * spent / frames:.2f} CPU ms per frame, which alone "
          f"would be {frames / spent:.1f} frames per second and core, {frames / spent / FPS:.2f} streams")
    return rate


def behind_haproxy() -> None:
    if not shutil.which("haproxy"):
        print("HAProxy is not installed and was not measured")
        return
    text = (pathlib.Path(__file__).resolve().parents[2] / "deploy/haproxy.cfg").read_text()
    port = free_port()
    with tempfile.TemporaryDirectory() as folder, replica(0) as (_, address):
        config = pathlib.Path(folder) / "haproxy.cfg"
        # Remove TLS, checks and root, to measure only the cost of forwarding frames.
        text = re.sub(r" +(user|group|chroot) .*\n", "", text)
        config.write_text(text.replace(":50051 ssl crt /etc/haproxy/candela.pem alpn h2", f"127.0.0.1:{port} proto h2")
                          .split("    server a ")[0] + f"    server a {address}\n")
        with subprocess.Popen(on_core(1, "haproxy", "-db", "-f", str(config)), stderr=subprocess.DEVNULL) as proxy:
            try:
                while subprocess.run([f"{BIN}/candela", "health", "--server", f"127.0.0.1:{port}"], stdout=subprocess.DEVNULL,
                                     stderr=subprocess.DEVNULL).returncode != 0:
                    if proxy.poll() is not None:
                        raise SystemExit("haproxy ended; try: haproxy -c -f deploy/haproxy.cfg")
                    time.sleep(0.1)
                before = cpu_seconds(proxy.pid)
                result = figures(load(1, f"127.0.0.1:{port}", 2, "max"))
                spent = cpu_seconds(proxy.pid) - before
            finally:
                proxy.kill()
    print(f"HAProxy, without TLS: {1000 * spent / result['frames']:.2f} CPU ms per frame, "
          f"{spent / result['frames'] / FRAME_BYTES * 1e9:.2f} s per gigabyte")


def main() -> None:
    if len(os.sched_getaffinity(0)) < 2:
        raise SystemExit("this process may use only one core; it needs cores 0 and 1")
    streams_per_core()
    one = max(throughput([0]), throughput([1]))
    two = throughput([0, 1])
    print(f"two replicas render {two / one:.2f} times as many frames as one\n")
    behind_haproxy()


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        raise SystemExit(__doc__)
    BIN, SECONDS = sys.argv[1], float(sys.argv[2]) if len(sys.argv) == 3 else 20
    main()
