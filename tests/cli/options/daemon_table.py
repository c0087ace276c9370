"""The option table of candelad: for every option, what shows that it works. As table.py."""
import json
import os
import pathlib
import signal
import socket
import subprocess
import threading
import time

from bench import Bench, Daemon, binary
from checks import hold
from harness import channel, end_of, frame_requests, free_port, grpc, render, rpc, v1, wait_until

LIMITS = {"--memory-budget": ("64MiB", "memory_budget_bytes", 64 << 20), "--max-frame-bytes": ("1MiB", "max_frame_bytes", 1 << 20),
          "--max-dimension": ("77", "max_dimension", 77), "--max-sessions": ("3", "max_sessions", 3),
          "--max-frames-in-flight": ("5", "max_frames_in_flight", 5),
          "--environment-budget": ("32MiB", "environment_budget_bytes", 32 << 20)}


def info(daemon: Daemon):
    with channel(daemon.address) as own:
        return rpc.RenderServiceStub(own).GetServerInfo(v1.GetServerInfoRequest(), timeout=10)


def limit(option: str):
    value, name, expected = LIMITS[option]

    def check(bench: Bench, _: str) -> None:
        with Daemon(option, value) as daemon:
            hold(getattr(info(daemon).limits, name) == expected, f"GetServerInfo says {getattr(info(daemon).limits, name)}")
    return check


def words_of(*options: str, code: int = 0) -> str:
    """What candelad prints before it ends by itself with `code`."""
    done = subprocess.run([binary("candelad"), *options], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, timeout=60)
    hold(done.returncode == code, f"candelad {' '.join(options)} ended with {done.returncode}: {done.stdout}")
    return done.stdout


def prints(option: str, expected: str):
    def check(bench: Bench, _: str) -> None:
        hold(expected in words_of(option), f"{option} does not print '{expected}'")
    return check


def session(address: str, name: str, sequence: int = 0, token: bytes = b"") -> tuple[str, bytes]:
    """A session of one frame: how it ends, and its token."""
    requests = [v1.StreamRequest(open=v1.StreamOpen(session=name, resume_token=token)), *frame_requests(sequence, 8, 8)]
    last = b""
    with channel(address) as own:
        try:
            for response in rpc.RenderServiceStub(own).Stream(iter(requests), timeout=20):
                if response.HasField("header"):
                    last = response.header.resume_token
            return "OK", last
        except grpc.RpcError as error:
            return error.code().name, last


class Held:
    """A Render call that has sent the first row of a square frame, and stays open."""

    def __init__(self, address: str, metadata: list | None = None, side: int = 64):
        self.over = threading.Event()
        self.channel = channel(address)

        def requests():
            yield v1.RenderRequest(start=v1.RenderStart(frame=v1.FrameHeader(
                width=side, height=side, format=v1.PIXEL_FORMAT_RGBA16F)))
            yield v1.RenderRequest(band=v1.Band(first_row=0, pixels=bytes(8 * side)))
            self.over.wait(60)

        self.call = rpc.RenderServiceStub(self.channel).Render(requests(), timeout=60, metadata=metadata)

    def end(self) -> str:
        code = end_of(self.call)[0]
        self.over.set()
        self.channel.close()
        return code


def listen(bench: Bench, _: str) -> None:
    unix = f"unix:{bench.folder}/d.sock"
    with Daemon(listen=f"127.0.0.1:{free_port()},{unix}") as daemon:
        for address in daemon.address.split(","):
            hold(render(address)[0] == "OK", f"{address} does not answer")


def insecure(bench: Bench, _: str) -> None:
    hold("--insecure" in words_of("--listen", "0.0.0.0:0", code=2), "the refusal does not name --insecure")
    with Daemon("--insecure", listen=f"0.0.0.0:{free_port()}"):
        pass


def guarded(option: str):
    """The guarded daemon of the workbench has it; without the client's part it does not answer."""
    needed = {"--tls-client-ca": "--tls-cert client.pem --tls-key client.key", "--token-file": "--token-file tokens",
              "--tls-cert": "--tls-ca ca.pem --tls-name candela.test", "--tls-key": "--tls-ca ca.pem --tls-name candela.test"}

    def check(bench: Bench, _: str) -> None:
        line = "info --server GUARDED " + " ".join(dict.fromkeys(needed.values()))
        hold(bench(line).code == 0, "a guarded server does not answer")
        hold(bench(line.replace(needed[option], "")).code != 0, f"a server with {option} answers everybody")
    return check


def device(bench: Bench, _: str) -> None:
    hold("no-such-device" in words_of("--device", "no-such-device", code=1), "the refusal does not name the device")
    with Daemon("--device", "llvmpipe") as daemon:
        hold("libvulkan" in maps(daemon), "Vulkan is not loaded")
    with Daemon("--device", "host") as daemon:
        hold(render(daemon.address)[0] == "OK", "it does not render")
        loaded = [name for name in ("libvulkan", "libLLVM") if name in maps(daemon)]
        hold(not loaded, f"it has loaded {loaded}")


def maps(daemon: Daemon) -> str:
    return pathlib.Path(f"/proc/{daemon.pid}/maps").read_text()


def executor(bench: Bench, _: str) -> None:
    for who in ("device", "host"):
        with Daemon("--executor", who) as daemon:
            hold(info(daemon).device.passes == who, f"GetServerInfo says {info(daemon).device.passes}")
    hold("auto, device or host" in words_of("--executor", "nobody", code=2), "the refusal does not name the choices")


def validation(bench: Bench, _: str) -> None:
    with Daemon("--validation") as daemon:
        hold("VkLayer_khronos_validation" in maps(daemon), "the validation layer is not loaded")


def max_calls(bench: Bench, _: str) -> None:
    with Daemon("--max-calls", "1") as daemon:
        held = Held(daemon.address)

        def second_is_refused() -> bool:
            nonlocal held
            if held.call.done():  # the one before came first, so this one was the second
                held = Held(daemon.address)
            return render(daemon.address)[0] == "UNAVAILABLE"
        hold(wait_until(second_is_refused, 5), "a second call is taken")
        held.call.cancel()


def max_connections(bench: Bench, _: str) -> None:
    with Daemon("--max-connections", "3") as daemon:
        host, port = daemon.address.split(":")
        lines = [socket.create_connection((host, int(port)), timeout=5) for _ in range(6)]
        hold(wait_until(lambda: sum(daemon.series("candela_connections_refused_total").values()) >= 3, 5), "no connection is refused")
        for line in lines:
            line.close()


def client_share(bench: Bench, _: str) -> None:
    """Beside another client, whose address the front would write, one that holds memory gets no more than its share."""
    def holds(share: str) -> int:
        unix = f"unix:{bench.folder}/share.sock"
        with Daemon("--client-share", share, "--memory-budget", "64MiB", listen=unix) as daemon:
            guest = Held(unix, [("x-forwarded-for", "192.0.2.1")])
            held = [Held(unix, [("x-forwarded-for", "192.0.2.2")], 512) for _ in range(16)]
            # Uploads that stall give their memory back after a while, so the most that they held counts.
            end, most = time.monotonic() + 4, 0
            while time.monotonic() < end:
                most = max(most, daemon.series("candela_memory_bytes")['pool="textures_in_use"'])
                time.sleep(0.05)
            for call in (guest, *held):
                call.call.cancel()
                call.over.set()
            return most
    few, many = holds("10"), holds("100")
    hold(0 < few < many, f"a share of 10 % holds {few} bytes, one of 100 % {many}")


def encoder_threads(bench: Bench, _: str) -> None:
    def threads(count: int) -> int:
        with Daemon("--encoder-threads", str(count)) as daemon:
            return len(os.listdir(f"/proc/{daemon.pid}/task"))
    more = threads(40) - threads(1)
    hold(more > 20, f"40 threads instead of one are {more} more")


def idle_timeout(bench: Bench, _: str) -> None:
    with Daemon("--idle-timeout", "300ms") as daemon:
        held = Held(daemon.address)
        code, words = end_of(held.call)
        held.end()
        hold(code == "DEADLINE_EXCEEDED" and "300ms" in words, f"a silent call ended with {code}: {words}")


def drain_timeout(bench: Bench, _: str) -> None:
    with Daemon("--drain-timeout", "500ms") as daemon:
        held = Held(daemon.address)
        # candelad's own measuring takes memory, too, so that does not say that the call is there.
        hold(wait_until(lambda: sum(daemon.series("candela_bytes_total").values()) > 0, 60), "no call is there")
        begin = time.monotonic()
        hold(daemon.stop() is not None and time.monotonic() - begin > 0.4, "the drain did not wait for the call")
        held.end()


def pre_drain(bench: Bench, _: str) -> None:
    with Daemon("--pre-drain", "5m") as daemon:
        daemon.process.send_signal(signal.SIGTERM)
        hold(wait_until(lambda: daemon.get("/readyz")[0] == 503, 60), "health goes on saying SERVING")
        hold(render(daemon.address)[0] == "OK", "a call during the pre-drain is refused")


def resume_keys(bench: Bench, _: str) -> None:
    keys = []
    for name, byte in (("one", "11"), ("two", "22")):
        keys.append(bench.folder / f"keys-{name}")
        keys[-1].write_text(byte * 32 + "\n")
        keys[-1].chmod(0o600)
    with Daemon("--resume-keys", str(keys[0])) as first:
        token = session(first.address, "keys")[1]
    for path, expected in ((keys[0], "OK"), (keys[1], "FAILED_PRECONDITION")):
        with Daemon("--resume-keys", str(path)) as other:
            code = session(other.address, "keys", 1, token)[0]
            hold(code == expected, f"another server with {path.name} answers {code}")


def resume_ttl(bench: Bench, _: str) -> None:
    with Daemon("--resume-ttl", "1s") as daemon:
        token = session(daemon.address, "ttl")[1]
        time.sleep(1.5)
        hold(session(daemon.address, "ttl", 1, token)[0] == "FAILED_PRECONDITION", "a token lives longer than that")


def metrics(bench: Bench, _: str) -> None:
    with Daemon() as daemon:  # has --metrics
        hold("candela_frames_total" in daemon.get("/metrics")[1], "no metrics there")


def log_level(bench: Bench, _: str) -> None:
    with Daemon("--log-level", "info") as loud, Daemon("--log-level", "off") as silent:
        hold("serving" in loud.words() and silent.words() == "", f"off writes {silent.words()!r}")


def log_json(bench: Bench, _: str) -> None:
    with Daemon("--log-json") as daemon:
        hold([json.loads(line)["event"] for line in daemon.words().splitlines()], "the log is empty")


def config(bench: Bench, _: str) -> None:
    path = bench.folder / "candelad.conf"
    path.write_text("max-dimension = 99\n")
    with Daemon("--config", str(path)) as daemon:
        hold(info(daemon).limits.max_dimension == 99, "the file changes nothing")


ROWS = {option: limit(option) for option in LIMITS} | {
    "--listen": listen, "--insecure": insecure, "--device": device, "--executor": executor, "--validation": validation,
    "--max-calls": max_calls, "--max-connections": max_connections, "--client-share": client_share, "--encoder-threads": encoder_threads, "--idle-timeout": idle_timeout,
    "--drain-timeout": drain_timeout, "--pre-drain": pre_drain, "--resume-keys": resume_keys, "--resume-ttl": resume_ttl,
    "--metrics": metrics, "--log-level": log_level, "--log-json": log_json, "--config": config,
    "--tls-cert": guarded("--tls-cert"), "--tls-key": guarded("--tls-key"), "--tls-client-ca": guarded("--tls-client-ca"),
    "--token-file": guarded("--token-file"), "--help": prints("--help", "Usage:"),
    "--print-config": prints("--print-config", "max-dimension = "), "--list-devices": prints("--list-devices", "Vulkan"),
    "--version": prints("--version", "candelad")}
