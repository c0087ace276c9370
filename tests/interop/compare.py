#!/usr/bin/env python3
"""Streams a sequence with stream_client.py and with `candela stream`, and compares the images.

compare.py CANDELA CANDELAD PROTO_FOLDER TO_PFM [FRAME...]
Without frames a procedural sequence is made. Needs python3-grpcio and protobuf-compiler-grpc.
"""
import hashlib
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "net"))
from png import png_parts  # noqa: E402

FPS = "24"


def run(*command: str) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, timeout=600).stdout


def main() -> None:
    candela, candelad, proto, to_pfm, *frames = sys.argv[1:]
    folder = pathlib.Path(tempfile.mkdtemp(prefix="candela-interop-"))
    daemon = None
    try:
        (folder / "stubs").mkdir()
        run("protoc", "-I", proto, f"--python_out={folder}/stubs", f"--grpc_out={folder}/stubs",
            f"--plugin=protoc-gen-grpc={shutil.which('grpc_python_plugin')}", f"{proto}/candela/v1/render.proto")
        (folder / "in").mkdir()
        if frames:
            for i, frame in enumerate(frames):
                run(to_pfm, frame, f"{folder}/in/{i:04d}.pfm")
        else:
            run(candela, "sample", "--sequence", f"{folder}/in/%04d.pfm", "--frames", "8", "--size", "320x200", "-q")
        files = sorted(str(path) for path in (folder / "in").iterdir())
        daemon = subprocess.Popen([candelad, "--listen", f"unix:{folder}/socket", "--log-level", "off"],
                                  stdout=subprocess.PIPE, text=True)
        server = daemon.stdout.readline().removeprefix("listening on ").strip()
        here = pathlib.Path(__file__).parent
        ours = run(sys.executable, str(here / "stream_client.py"), f"{folder}/stubs", server, FPS, *files)
        lines = run(candela, "stream", f"{folder}/in", f"{folder}/out", "--fps", FPS, "--server", server, "--json", "-",
                    "-q")
        theirs = [json.loads(line) for line in lines.splitlines()][:-1]
        passed = 0
        for line, frame in zip(ours.splitlines(), theirs, strict=True):
            sequence, digest, exposure = line.split()
            png = hashlib.sha256(png_parts(pathlib.Path(frame["output"]).read_bytes())[1]).hexdigest()
            if digest != png or float(exposure) != frame["exposure"]:
                raise SystemExit(f"frame {sequence} differs: {digest} at {exposure}, the command {png} at "
                                 f"{frame['exposure']}")
            passed += 1
        exposures = {frame["exposure"] for frame in theirs}
        print(f"{passed} frames are the same bit for bit, at {len(exposures)} exposures")
        if passed != len(files) or passed == 0:
            raise SystemExit(f"{len(files)} frames were sent")
    finally:
        if daemon is not None:
            daemon.terminate()
            daemon.wait()
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
