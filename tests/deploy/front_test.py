#!/usr/bin/env python3
"""What deploy/candela-front's nginx promises beside its defence against floods (edge_test.py): TLS, client certificates, and
the limits of one address. `front_test.py CLAIM BIN` runs one test. BIN contains candela and candelad.

Each claim is a function below, and CLAIM is its name in CamelCase. nginx and candelad run as processes of this machine.
"""
import concurrent.futures
import contextlib
import os
import pathlib
import queue
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "robustness"))
os.environ["CANDELA_BIN"] = sys.argv[2] if len(sys.argv) > 2 else ""

import harness  # noqa: E402
from harness import Daemon, binary, end_of, expect, grpc, rpc, v1  # noqa: E402
from podman import attempt, get, run, wait_until  # noqa: E402
from shapes import Front  # noqa: E402

try:
    import h2.config
    import h2.connection
    import h2.events
    import h2.exceptions
except ImportError as missing:
    harness.skip(f"{missing}; run deploy/install-packages.sh test")

FOLDER = pathlib.Path()
WIDTH, HEIGHT = 16, 9
RENDER = "/candela.v1.RenderService/Render"
FROM_CANDELAD = "3"  # INVALID_ARGUMENT: what candelad says to a call without a body


@contextlib.contextmanager
def fronted(**settings: object):
    """candelad behind its front, with these PROXY_* variables: the front and the daemon."""
    with Daemon(listen=f"unix:{FOLDER}/candelad.sock", metrics=False) as daemon, Front(daemon.address, **settings) as front:
        yield front, daemon


class Authority:
    """A CA. `path` is its certificate."""

    def __init__(self, name: str):
        self.path, self.key = FOLDER / f"{name}.pem", FOLDER / f"{name}-ca.key"
        run("openssl", "req", "-x509", *NEW_KEY, "-days", "2", "-subj", f"/CN={name}", "-keyout", self.key, "-out", self.path)

    def signs(self, name: str, days: int = 2) -> "Certificate":
        """A new certificate of 127.0.0.1 in NAME.crt and NAME.key. Both files are replaced, one after the other."""
        certificate, new, request, names = (Certificate(name), *(FOLDER / f"unready{end}" for end in ("", ".csr", ".ext")))
        names.write_text("subjectAltName=IP:127.0.0.1\n")
        run("openssl", "req", *NEW_KEY, "-subj", f"/CN={name}", "-keyout", f"{new}.key", "-out", request)
        run("openssl", "x509", "-req", "-days", days, "-CA", self.path, "-CAkey", self.key, "-CAcreateserial", "-extfile", names,
            "-in", request, "-out", f"{new}.crt")
        for ending in (".key", ".crt"):
            pathlib.Path(f"{new}{ending}").rename(f"{FOLDER / name}{ending}")
        return certificate


NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


class Certificate:
    def __init__(self, name: str):
        self.path, self.key = FOLDER / f"{name}.crt", FOLDER / f"{name}.key"

    def read(self) -> tuple[bytes, bytes]:
        """The key and the certificate, as gRPC wants them."""
        return self.key.read_bytes(), self.path.read_bytes()


def secure(front: Front, ca: Authority, client: Certificate | None = None) -> grpc.Channel:
    mine = client.read() if client else (None, None)
    return grpc.secure_channel(front.address, grpc.ssl_channel_credentials(ca.path.read_bytes(), *mine),
                               [("grpc.use_local_subchannel_pool", 1)])


def render(channel: grpc.Channel) -> str:
    """The code of one Render call on a channel that it closes."""
    with channel:
        return end_of(rpc.RenderServiceStub(channel).Render(harness.render_requests(WIDTH, HEIGHT), timeout=20))[0]


class Session:
    """A Stream call whose frames are sent one by one."""

    def __init__(self, channel: grpc.Channel, name: str):
        self.requests: queue.Queue = queue.Queue()
        self.call = rpc.RenderServiceStub(channel).Stream(iter(self.requests.get, None), timeout=60)
        self.requests.put(v1.StreamRequest(open=v1.StreamOpen(session=name)))

    def frame(self, sequence: int) -> None:
        """Sends a frame and waits for its last row."""
        for request in harness.frame_requests(sequence, WIDTH, HEIGHT):
            self.requests.put(request)
        for response in self.call:
            if response.HasField("band") and response.band.first_row + len(response.band.pixels) // (WIDTH * 4) == HEIGHT:
                return

    def end(self) -> None:
        self.requests.put(None)
        for _ in self.call:
            pass


def answer(address: str, *extra: tuple[str, str], source: str = "127.0.0.1") -> dict[str, str]:
    """The headers and trailers that answer a call without a body, from the address `source`; {} if the server hung up."""
    host, port = address.rsplit(":", 1)
    http2 = h2.connection.H2Connection(h2.config.H2Configuration(header_encoding="utf-8"))
    http2.initiate_connection()
    http2.send_headers(1, [(":method", "POST"), (":scheme", "http"), (":path", RENDER), (":authority", address),
                           ("te", "trailers"), ("content-type", "application/grpc"), *extra], end_stream=True)
    said: dict[str, str] = {}
    with socket.create_connection((host, int(port)), 10, (source, 0)) as wire:
        wire.sendall(http2.data_to_send())
        while got := wire.recv(1 << 16):
            for event in http2.receive_data(got):
                said |= dict(getattr(event, "headers", None) or [])
                if isinstance(event, (h2.events.StreamEnded, h2.events.StreamReset, h2.events.ConnectionTerminated)):
                    return said
            wire.sendall(http2.data_to_send())
    return said


def a_client_needs_tls_and_a_certificate_of_the_named_ca() -> None:
    ours, theirs = Authority("ours"), Authority("theirs")
    server, client, stranger = ours.signs("server"), ours.signs("client"), theirs.signs("stranger")
    with fronted(PROXY_CERT=server.path, PROXY_CLIENT_CA=ours.path) as (front, _):
        with_ca = (binary("candela"), "health", "--server", front.address, "--tls-ca", ours.path)
        run(*with_ca, "--tls-cert", client.path, "--tls-key", client.key)
        expect(render(secure(front, ours, client)) == "OK", "a client with its certificate is refused")
        for who, channel in (("no certificate", secure(front, ours)), ("another CA's certificate", secure(front, ours, stranger)),
                             ("no TLS", harness.channel(front.address))):
            code = render(channel)
            expect(code not in ("OK", "DEADLINE_EXCEEDED"), f"with {who}, a call ends with {code}")
        expect(attempt(*with_ca).returncode == 1, "candela health serves without a certificate")
    with fronted(PROXY_CERT=server.path) as (front, _):
        expect(render(secure(front, ours)) == "OK", "without PROXY_CLIENT_CA, a client needs a certificate")


def changed_certificates_are_loaded_and_open_sessions_go_on() -> None:
    first, second = Authority("first"), Authority("second")
    server, old_client, new_client = first.signs("server"), first.signs("old"), second.signs("new")
    clients = FOLDER / "clients.pem"
    clients.write_bytes(first.path.read_bytes())

    def served() -> str:
        host, port = front.address.rsplit(":", 1)
        return ssl.get_server_certificate((host, int(port)), timeout=5)

    with fronted(PROXY_CERT=server.path, PROXY_CLIENT_CA=clients) as (front, _), secure(front, first, old_client) as channel:
        session = Session(channel, "open-meanwhile")
        session.frame(0)
        expect(served() == server.path.read_text(), "it does not show its certificate")
        server = second.signs("server")
        clients.write_bytes(second.path.read_bytes())
        wait_until(lambda: served() == server.path.read_text() and render(secure(front, second, new_client)) == "OK",
                   "the new certificates are loaded", front.words, 15)
        expect(render(secure(front, second, old_client)) != "OK", "a client of the old CA is not refused")
        session.frame(1)
        good = server.path.read_text()
        server.path.write_text("no certificate\n")
        wait_until(lambda: "keeps the old certificate" in front.words(), "the front says that it keeps the old one", front.words, 15)
        expect(served() == good and render(secure(front, second, new_client)) == "OK", "the last good certificate is gone")
        session.frame(2)
        session.end()


def a_call_too_many_is_unavailable_until_another_ends() -> None:
    with fronted(PROXY_CALLS=2) as (front, _), harness.channel(front.address) as channel:
        open_ones = [Session(channel, f"open-{number}") for number in range(2)]
        for session in open_ones:
            session.frame(0)
        code = render(harness.channel(front.address))
        expect(code == "UNAVAILABLE", f"a third call of an address that may have two ends with {code}")
        other = answer(front.address, source="127.0.1.2")
        expect(other.get("grpc-status") == FROM_CANDELAD, f"another address is refused, too: {other}")
        for session in open_ones:
            session.frame(1)
        run(binary("candela"), "sample", FOLDER / "scene.pfm", "--size", "16x9", "-q")
        command = (binary("candela"), "render", FOLDER / "scene.pfm", FOLDER / "out.png", "--server", front.address)
        refused = attempt(*command, "--resume", 0)
        expect(refused.returncode == 4 and "takes no more calls from this address" in refused.stderr, f"the command says: {refused.stderr}")
        with concurrent.futures.ThreadPoolExecutor() as pool:
            waiting = pool.submit(attempt, *command)
            expect(not concurrent.futures.wait([waiting], 2).done, f"the command does not wait for its turn: {waiting.done() and waiting.result()}")
            open_ones[0].end()
            expect(waiting.result().returncode == 0, f"the command does not come in: {waiting.result().stderr}")
        open_ones[1].end()


def calls_that_come_too_fast_are_unavailable() -> None:
    with fronted(PROXY_RATE=3) as (front, _):
        codes = set()
        with concurrent.futures.ThreadPoolExecutor(12) as pool:
            def refused() -> bool:
                codes.update(pool.map(lambda _: render(harness.channel(front.address)), range(12)))
                return len(codes) > 1

            wait_until(refused, "some of 12 calls are refused, where 3 a second are allowed", lambda: str(codes), every=0)
        expect(codes == {"OK", "UNAVAILABLE"}, f"calls that come too fast end with {codes}")
        other = answer(front.address, source="127.0.1.2")
        expect(other.get("grpc-status") == FROM_CANDELAD, f"another address is refused, too: {other}")
        wait_until(lambda: render(harness.channel(front.address)) == "OK", "calls are taken again", seconds=60)


class Recorder(grpc.GenericRpcHandler):
    """A server in candelad's place. `seen` has the headers of each call."""

    def __init__(self):
        self.seen: list[list[tuple[str, str]]] = []

    def service(self, details):
        self.seen.append([tuple(pair) for pair in details.invocation_metadata])


@contextlib.contextmanager
def recorder():
    """A recorder behind the front: both."""
    server, record = grpc.server(concurrent.futures.ThreadPoolExecutor(2)), Recorder()
    server.add_generic_rpc_handlers((record,))
    address = f"unix:{FOLDER}/recorder.sock"
    server.add_insecure_port(address)
    server.start()
    try:
        with Front(address) as front:
            yield front, record
    finally:
        server.stop(None)


def a_forged_address_is_replaced() -> None:
    """candelad tells clients apart by x-forwarded-for, so a client must not choose it."""
    with recorder() as (front, record):
        answer(front.address, ("x-forwarded-for", "192.0.2.7"), ("X-Forwarded-For".lower(), "192.0.2.8, 192.0.2.9"), source="127.0.1.2")
        expect(len(record.seen) == 1, f"one call came as {len(record.seen)}")
        named = [value for name, value in record.seen[0] if name == "x-forwarded-for"]
        expect(named == ["127.0.1.2"], f"candelad would see the addresses {named}")


def headers_of_5_kb_do_not_reach_candelad() -> None:
    with recorder() as (front, record):
        small = answer(front.address, ("x-pad", "p" * 3000))
        expect(small.get(":status") == "200" and len(record.seen) == 1, f"3 KB of headers are refused: {small}")
        for pads in ([("x-pad", "~" * 5000)], [(f"x-pad-{number}", "~" * 100) for number in range(50)]):
            large = answer(front.address, *pads)
            expect(large.get(":status", "") != "200" and len(record.seen) == 1, f"5 KB of headers in {len(pads)} are answered by {large}")
        answer(front.address)
        expect(len(record.seen) == 2, "after large headers, nothing is taken")


def a_stop_waits_for_candelad_and_not_for_the_socket_of_a_killed_one() -> None:
    with fronted() as (front, daemon):
        front.process.terminate()
        time.sleep(3)
        expect(not front.ended(), f"the front does not wait for candelad: {front.words()}")
        daemon.process.kill()
        daemon.process.wait()
        expect(pathlib.Path(daemon.address.removeprefix("unix:")).is_socket(), "the socket is gone, so this shows nothing")
        wait_until(front.ended, "the front ends after candelad was killed", front.words, 60)
        expect(front.process.returncode == 0, front.trouble())


def wrong_settings_end_it_with_2() -> None:
    certificate = Authority("ours").signs("server")
    for words, settings in (("PROXY_INSECURE", {}), ("PROXY_CLIENT_CA needs", {"PROXY_CLIENT_CA": certificate.path}),
                            ("cannot read", {"PROXY_CERT": FOLDER / "none.crt"}),
                            ("cannot read", {"PROXY_CERT": certificate.path, "PROXY_CLIENT_CA": FOLDER / "none.pem"}),
                            ("PROXY_CALLS", {"PROXY_INSECURE": "true", "PROXY_CALLS": 0}),
                            ("PROXY_RATE", {"PROXY_INSECURE": "true", "PROXY_RATE": "many"}),
                            ("PROXY_SERVER", {"PROXY_INSECURE": "true", "PROXY_SERVER": "127.0.0.1:50051"})):
        done = attempt("env", *(f"{name}={value}" for name, value in settings.items()), HERE.parents[1] / "deploy/candela-front",
                       "--proxy-only", timeout=20)
        lines = done.stderr.splitlines()
        expect(done.returncode == 2 and len(lines) == 1 and words in lines[0], f"{settings}: {done.returncode}, {lines}")


def whole(folder: pathlib.Path, *options: str, conf: pathlib.Path | None = None, **settings: object) -> subprocess.Popen:
    """The front with its own candelad, whose socket is in `folder`. Its stderr is a pipe."""
    path = f"{pathlib.Path(binary('candelad')).parent}:{os.environ['PATH']}"
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PROXY_", "CANDELA_LISTEN"))}
    given = {"PATH": path, "PROXY_INSECURE": "true", "PROXY_LISTEN": f"127.0.0.1:{harness.free_port()}",
             "PROXY_STATUS": f"127.0.0.1:{harness.free_port()}", "PROXY_SERVER": f"unix:{folder}/candelad.sock"} | settings
    if conf:
        given["PROXY_CONF"] = conf
    return subprocess.Popen([HERE.parents[1] / "deploy/candela-front", *options], stdin=subprocess.DEVNULL, text=True,
                            stderr=subprocess.PIPE, env=clean | {name: str(value) for name, value in given.items()})


def needs_nginx() -> None:
    if not shutil.which("nginx"):
        harness.skip("nginx is not installed; run deploy/install-packages.sh deploy")


def candelad_listens_on_the_socket_of_its_front() -> None:
    """Without an option, and when an option names more addresses."""
    needs_nginx()
    conf = FOLDER / "own.conf"  # nginx's workers run as whoever runs this
    conf.write_text("user root;\n" * (os.geteuid() == 0) + (HERE.parents[1] / "deploy/nginx.conf").read_text())
    for number, options in enumerate(((), ("--listen", f"127.0.0.1:{harness.free_port()},unix:{FOLDER}/candelad.sock"))):
        listen = f"127.0.0.1:{harness.free_port()}"
        front = whole(FOLDER, *options, conf=conf, PROXY_LISTEN=listen)
        try:
            wait_until(lambda: front.poll() is not None or render(harness.channel(listen)) == "OK", f"a call comes through ({number})",
                       seconds=60)
            expect(front.poll() is None, f"the front ended: {front.poll() is not None and front.stderr.read()}")
        finally:
            front.terminate()
            front.wait()
        expect(front.returncode == 0, f"a stop ends it with {front.returncode}: {front.stderr.read()}")


def another_socket_than_candelads_ends_it_with_2() -> None:
    needs_nginx()
    for options, settings, named in ((("--listen", "127.0.0.1:0"), {}, "--listen is '127.0.0.1:0'"),
                                     (("--listen=unix:/nowhere",), {}, "--listen is 'unix:/nowhere'"),
                                     ((), {"CANDELA_LISTEN": "127.0.0.1:0,unix:/x"}, "CANDELA_LISTEN is '127.0.0.1:0,unix:/x'")):
        front = whole(FOLDER, *options, **settings)
        words = front.communicate(timeout=20)[1].splitlines()
        expect(front.returncode == 2 and len(words) == 1 and named in words[0] and f"unix:{FOLDER}/candelad.sock" in words[0],
               f"{options}, {settings}: {front.returncode}, {words}")


def it_does_not_run_workers_that_cannot_reach_candelad() -> None:
    """A folder that they may not enter, and a socket that they may not write; with a candelad of its own and without."""
    needs_nginx()
    closed = FOLDER / "closed"
    closed.mkdir()
    with Daemon(listen=f"unix:{closed}/candelad.sock", metrics=False):
        socket_file = closed / "candelad.sock"
        socket_file.chmod(0o600 if os.geteuid() == 0 else 0o000)
        FOLDER.chmod(0o755)
        for mode, named in ((0o755, f"the socket {socket_file}"), (0o700 if os.geteuid() == 0 else 0o000, f"the folder {closed}")):
            closed.chmod(mode)
            front = whole(closed, "--proxy-only")
            words = front.communicate(timeout=20)[1].splitlines()
            expect(front.returncode == 2 and len(words) == 1 and f"cannot reach {named}" in words[0],
                   f"{mode:o}: {front.returncode}, {words}")
        closed.chmod(0o755)
        socket_file.chmod(0o777)
        front = whole(closed, "--proxy-only", PROXY_STATUS=f"127.0.0.1:{(port := harness.free_port())}")
        try:
            wait_until(lambda: get(port, "/livez")[0] == 200, "nginx answers", seconds=20)
        finally:
            front.send_signal(signal.SIGQUIT)
            front.communicate()
    if os.geteuid() == 0:  # candelad's socket is root's, and nginx's workers are somebody else
        front = whole(FOLDER)
        words = front.communicate(timeout=60)[1]
        expect(front.returncode == 2 and f"cannot reach the socket {FOLDER}/candelad.sock" in words, f"{front.returncode}, {words}")
        expect(not (FOLDER / "candelad.sock").exists(), "candelad goes on")


def its_metrics_say_when_its_certificate_expires() -> None:
    """Also after another one was loaded; some years have two digits in a certificate, and others four."""
    ours = Authority("ours")
    server = ours.signs("server")

    def said(front: Front) -> float:
        found = re.search(r"^candela_certificate_expiry_timestamp_seconds (\d+)$", get(front.status, "/metrics")[1], re.M)
        return float(found.group(1)) if found else 0

    def should() -> float:
        text = run("openssl", "x509", "-in", server.path, "-noout", "-enddate").removeprefix("notAfter=")
        return ssl.cert_time_to_seconds(text)

    with fronted(PROXY_CERT=server.path) as (front, _):
        expect(said(front) == should() > 0, f"it says {said(front)}, not {should()}")
        ours.signs("server", days=20_000)
        expect(should() > 2_524_608_000, "the new one expires before 2050")
        wait_until(lambda: said(front) == should(), "the new certificate's end is shown", front.words, 15)
    with fronted() as (front, _):
        expect(said(front) == 0, "without a certificate it says when that expires")


CLAIMS = {claim.__name__: claim for claim in (
    a_client_needs_tls_and_a_certificate_of_the_named_ca, changed_certificates_are_loaded_and_open_sessions_go_on,
    a_call_too_many_is_unavailable_until_another_ends, calls_that_come_too_fast_are_unavailable, a_forged_address_is_replaced,
    headers_of_5_kb_do_not_reach_candelad, a_stop_waits_for_candelad_and_not_for_the_socket_of_a_killed_one,
    wrong_settings_end_it_with_2, candelad_listens_on_the_socket_of_its_front, another_socket_than_candelads_ends_it_with_2,
    it_does_not_run_workers_that_cannot_reach_candelad, its_metrics_say_when_its_certificate_expires)}


def main() -> None:
    global FOLDER
    claim = CLAIMS[re.sub("(?<!^)([A-Z]|[0-9]+)", r"_\1", sys.argv[1]).lower()]
    with tempfile.TemporaryDirectory(prefix="candela-front-") as folder:
        FOLDER = pathlib.Path(folder)
        claim()


if __name__ == "__main__":
    main()
