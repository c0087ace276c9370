"""gRPC's errors are errors in the log, one a second for each place of its source, with the number of the others."""
import json
import pathlib
import socket
import subprocess
import tempfile
import time

from harness import Daemon, expect, report, skip

ATTEMPTS = 300

with tempfile.TemporaryDirectory() as folder:
    cert, key = f"{folder}/cert.pem", f"{folder}/key.pem"
    try:
        subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", key, "-out", cert, "-days", "1",
                        "-subj", "/CN=localhost"], check=True, capture_output=True)
    except FileNotFoundError:
        skip("no openssl; run deploy/install-packages.sh test")
    pathlib.Path(key).chmod(0o600)

    def shout(address: str) -> None:
        """Plain HTTP on a port with TLS, which gRPC calls a fatal error."""
        host, port = address.rsplit(":", 1)
        with socket.create_connection((host, int(port)), timeout=5) as connection:
            connection.sendall(b"GET / HTTP/1.1\r\n\r\n")
            connection.recv(100)

    with Daemon("--tls-cert", cert, "--tls-key", key, "--log-json") as daemon:
        begin = time.monotonic()
        for _ in range(ATTEMPTS):
            shout(daemon.address)
        seconds = time.monotonic() - begin
        time.sleep(1.2)
        shout(daemon.address)  # says how many were left out
        time.sleep(0.3)
        expect(daemon.stop() == 0, "it did not end with 0")
        lines = [line for line in map(json.loads, daemon.words().splitlines()) if line["event"] == "grpc"]
        told = sum(line["left_out"] + 1 for line in lines)
        report(attempts=ATTEMPTS + 1, seconds=round(seconds, 1), lines=len(lines), told=told)
        expect(lines and all(line["level"] == "error" for line in lines), f"gRPC's errors are not logged as errors: {lines[:2]}")
        expect(len(lines) <= seconds + 3, f"{len(lines)} lines in {seconds:.1f} s")
        expect(told == ATTEMPTS + 1, f"the lines tell of {told} errors of {ATTEMPTS + 1}")
