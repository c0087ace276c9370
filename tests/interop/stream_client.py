#!/usr/bin/env python3
"""Streams PFM files to a candelad and prints the SHA-256 of each image: a client of render.proto and nothing else.

stream_client.py STUBS SERVER FPS FILE...
STUBS is a folder with what protoc made of candela/v1/render.proto for Python.
"""
import hashlib
import pathlib
import queue
import struct
import sys
import threading

import grpc

sys.path.insert(0, sys.argv[1])
from candela.v1 import render_pb2 as v1  # noqa: E402
from candela.v1 import render_pb2_grpc  # noqa: E402

BAND_BYTES = 2 << 20


def read_pfm(path: str) -> tuple[int, int, bytes]:
    """Width, height and RGBA float pixels, little-endian, rows from the top."""
    kind, size, scale, pixels = pathlib.Path(path).read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    if kind != b"PF" or float(scale) > 0 or len(pixels) != width * height * 12:
        raise SystemExit(f"{path}: not a little-endian colour PFM")
    row = struct.Struct(f"<{width * 3}f")
    out = []
    for y in range(height - 1, -1, -1):
        rgb = row.unpack_from(pixels, y * row.size)
        rgba = [1.0] * (4 * width)
        for channel in range(3):
            rgba[channel::4] = rgb[channel::3]
        out.append(struct.pack(f"<{4 * width}f", *rgba))
    return width, height, b"".join(out)


def requests(paths: list[str], fps: float, room: threading.Semaphore, opened: threading.Event):
    """The session's messages. Waits while the server holds as many frames without a result as it can."""
    yield v1.StreamRequest(open=v1.StreamOpen(session="interop"))
    opened.wait()
    for sequence, path in enumerate(paths):
        width, height, pixels = read_pfm(path)
        room.acquire()
        yield v1.StreamRequest(frame=v1.FrameHeader(
            sequence=sequence, width=width, height=height, format=v1.PIXEL_FORMAT_RGBA32F,
            total_bytes=len(pixels), media_time_ns=round(sequence * 1e9 / fps)))
        row_bytes = 16 * width
        rows = max(1, BAND_BYTES // row_bytes)
        for first in range(0, height, rows):
            band = pixels[first * row_bytes:(first + rows) * row_bytes]
            yield v1.StreamRequest(band=v1.Band(first_row=first, pixels=band))


def main() -> None:
    server, fps, paths = sys.argv[2], float(sys.argv[3]), sys.argv[4:]
    room, opened, due = threading.Semaphore(0), threading.Event(), queue.Queue()
    with grpc.insecure_channel(server) as channel:
        stub = render_pb2_grpc.RenderServiceStub(channel)
        responses = stub.Stream(requests(paths, fps, room, opened), metadata=[("x-session-id", "interop")])
        header, image = None, b""
        for response in responses:
            part = response.WhichOneof("part")
            if part == "opened":
                for _ in range(response.opened.max_frames_in_flight):
                    room.release()
                opened.set()
            elif part == "header":
                header, image = response.header, b""
                if not 0 < len(header.resume_token) <= 1024:
                    raise SystemExit(f"frame {header.sequence}: a token of {len(header.resume_token)} bytes")
            elif part == "band":
                if response.band.first_row * header.width * 4 != len(image):
                    raise SystemExit(f"frame {header.sequence}: bands are out of order")
                image += response.band.pixels
                if len(image) == header.width * header.height * 4:
                    due.put(header.sequence)
                    room.release()
                    # Leave out alpha, as `candela stream` does for frames without alpha.
                    rgb = bytearray(3 * header.width * header.height)
                    for channel_index in range(3):
                        rgb[channel_index::3] = image[channel_index::4]
                    print(header.sequence, hashlib.sha256(rgb).hexdigest(), repr(header.exposure), flush=True)
            else:
                raise SystemExit(f"the server says {part}: {response}")
    if list(due.queue) != list(range(len(paths))):
        raise SystemExit(f"results came for {list(due.queue)}")


if __name__ == "__main__":
    main()
