#!/usr/bin/env python3
"""Streams a sequence with stream_client.py and with `candela stream`, and compares the images.

compare.py CANDELA CANDELAD PROTO_FOLDER TO_PFM [FRAME...]
Without frames a procedural sequence is made. Needs python3-grpcio and protobuf-compiler-grpc.
"""
import hashlib
import json
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib

FPS = "24"


def run(*command: str) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, timeout=600).stdout


def png_pixels(path: pathlib.Path) -> bytes:
    """The bytes of an 8-bit RGB PNG that is not interlaced."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + length]
        at += 12 + length
        if kind == b"IHDR":
            width, height, *rest = struct.unpack(">IIBBBBB", body)
            if rest != [8, 2, 0, 0, 0]:
                raise SystemExit(f"{path}: not 8-bit RGB")
        elif kind == b"IDAT":
            packed += body
    raw, stride = zlib.decompress(packed), 3 * width
    before, out = bytearray(stride), bytearray()
    for y in range(height):
        start = y * (stride + 1)
        row = bytearray(raw[start + 1:start + 1 + stride])
        unfilter(raw[start], row, before)
        out += row
        before = row
    return bytes(out)


def unfilter(kind: int, row: bytearray, above: bytearray) -> None:
    size = len(row)
    if kind == 1:
        for x in range(3, size):
            row[x] = (row[x] + row[x - 3]) & 255
    elif kind == 2:
        row[:] = bytes((value + up) & 255 for value, up in zip(row, above))
    elif kind == 3:
        for x in range(size):
            row[x] = (row[x] + ((row[x - 3] if x >= 3 else 0) + above[x]) // 2) & 255
    elif kind == 4:
        left, corner = [0, 0, 0], [0, 0, 0]
        for x in range(size):
            a, b, c = left[x % 3], above[x], corner[x % 3]
            pa, pb, pc = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            row[x] = (row[x] + (a if pa <= pb and pa <= pc else b if pb <= pc else c)) & 255
            left[x % 3], corner[x % 3] = row[x], b


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
            png = hashlib.sha256(png_pixels(pathlib.Path(frame["output"]))).hexdigest()
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
