"""The net's own client of render.proto: resume tokens, a change of settings in a session, and refusals.

Only here can it see what the command keeps to itself. Needs python3-grpcio and protobuf-compiler-grpc.
"""
import hashlib
import hmac
import pathlib
import queue
import shutil
import struct
import subprocess
import sys

import grpc

from cases import Case
from outcome import Outcome, digest
from png import comparable

KEY = bytes(range(32))
ROOT = pathlib.Path(__file__).resolve().parents[2]


def make_stubs(folder: pathlib.Path) -> None:
    """Generates the Python stubs into `folder` and makes them importable."""
    plugin = shutil.which("grpc_python_plugin")
    subprocess.run(["protoc", "-I", ROOT / "proto", f"--python_out={folder}", f"--grpc_out={folder}",
                    f"--plugin=protoc-gen-grpc={plugin}", ROOT / "proto/candela/v1/render.proto"], check=True,
                   timeout=60)
    sys.path.insert(0, str(folder))


def fields(body: bytes) -> list[tuple[int, object]]:
    """A protobuf message's fields, by number, in the order in which they stand."""
    out, at = [], 0

    def varint() -> int:
        nonlocal at
        value, shift = 0, 0
        while True:
            byte = body[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    while at < len(body):
        tag = varint()
        if tag & 7 == 0:
            out.append((tag >> 3, varint()))
        else:
            size = {1: 8, 5: 4}.get(tag & 7) or varint()
            out.append((tag >> 3, body[at:at + size]))
            at += size
    return out


EXPOSURE_FIELD, EXPIRES_FIELD = 4, 7


def token_text(token: bytes) -> str:
    """A token's contents except its time. If it is not signed with KEY, the contents say so."""
    size = struct.unpack_from(">H", token, 9)[0]
    body, mac = token[11:11 + size], token[11 + size:]
    good = mac == hmac.new(KEY, token[:11 + size], hashlib.sha256).digest()
    words = [f"version {token[0]} key {token[1:9].hex()} {'signed' if good else 'NOT SIGNED'}"]
    for number, value in fields(body):
        if number == EXPOSURE_FIELD:
            words += [f"4.{inner} {text(what)}" for inner, what in fields(value)]
        elif number != EXPIRES_FIELD:
            words.append(f"{number} {text(value)}")
    return " ".join(words)


def text(value) -> str:
    return value.hex() if isinstance(value, bytes) else str(value)


def read_pfm(path: pathlib.Path) -> tuple[int, int, bytes]:
    """Width, height and RGBA float pixels, rows from the top."""
    _, size, _, pixels = path.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    one, rows = struct.pack("<f", 1.0), []
    for y in range(height - 1, -1, -1):
        row = pixels[y * width * 12:(y + 1) * width * 12]
        rows.append(b"".join(row[12 * x:12 * x + 12] + one for x in range(width)))
    return width, height, b"".join(rows)


class Client:
    """Calls one server. Every method makes a separate call, so several threads may use it."""

    def __init__(self, address: str, scenes: pathlib.Path):
        from candela.v1 import render_pb2, render_pb2_grpc  # made by make_stubs
        self.v1 = render_pb2
        self.scenes = scenes
        self.stub = render_pb2_grpc.RenderServiceStub(grpc.insecure_channel(address))
        self.frames = [read_pfm(path) for path in sorted((scenes / "sequence").iterdir())]

    def frame_messages(self, frame: tuple[int, int, bytes], request, sequence: int, **header):
        """A session's frame as its header and one band."""
        width, height, pixels = frame
        fields_of = {"sequence": sequence, "width": width, "height": height, "format": self.v1.PIXEL_FORMAT_RGBA32F,
                     "media_time_ns": sequence * 40_000_000} | header
        return [request(frame=self.v1.FrameHeader(**fields_of)),
                request(band=self.v1.Band(first_row=0, pixels=pixels))]

    def render(self, settings, **start) -> Outcome:
        """A frame of the procedural sequence, or the view that `frame` has in place of pixels."""
        v1, (width, height, pixels) = self.v1, self.frames[8]
        header = start.pop("frame", {})
        bands = [] if "view" in header else [v1.RenderRequest(band=v1.Band(first_row=0, pixels=pixels))]
        if bands:
            header = {"width": width, "height": height, "format": v1.PIXEL_FORMAT_RGBA32F} | header
        start = v1.RenderStart(settings=settings, frame=v1.FrameHeader(**header), **start)
        requests = [v1.RenderRequest(start=start), *bands]
        image, values = b"", {}
        try:
            for response in self.stub.Render(iter(requests), timeout=120):
                part = response.WhichOneof("part")
                if part == "header":
                    values = self.header_values(response.header)
                else:
                    image += getattr(response, part).pixels
        except grpc.RpcError as error:
            return Outcome(error.code().name)
        return Outcome("OK", digest(comparable(image)), values)

    @staticmethod
    def header_values(header) -> dict[str, str]:
        values = {name: repr(getattr(header, name)) for name in
                  ("sequence", "width", "height", "format", "exposure", "target", "prescale", "tier",
                   "exposure_before", "cut", "encoding")}
        for name in ("mean_log2_luminance", "min_luminance", "max_luminance", "nan_components"):
            values[name] = repr(getattr(header.statistics, name))
        if header.resume_token:
            values["token"] = token_text(header.resume_token)
        return values

    def stream(self, messages, **opening) -> tuple[str, list[tuple[dict[str, str], str, bytes]]]:
        """One session: its status and, for each result, the header's values, the image's hash and the token.

        `messages` are sent one frame's at a time, as results make room for them.
        """
        v1, room = self.v1, queue.Queue()
        results, image, values, token = [], b"", None, b""

        def requests():
            yield v1.StreamRequest(open=v1.StreamOpen(**opening))
            for message in messages:
                if message.WhichOneof("part") == "frame":
                    room.get()
                yield message

        def close_image():
            if values is not None:
                results.append((values, digest(comparable(image)), token))

        try:
            for response in self.stub.Stream(requests(), metadata=[("x-session-id", opening["session"])],
                                             timeout=120):
                part = response.WhichOneof("part")
                if part == "opened":
                    for _ in range(response.opened.max_frames_in_flight + opening.get("lookahead", 0)):
                        room.put(None)
                elif part in ("header", "failure"):
                    close_image()
                    image, token = b"", getattr(response, part).resume_token
                    values = (self.header_values(response.header) if part == "header" else
                              {"failure": str(response.failure.code), "token": token_text(token)})
                    room.put(None)
                elif part in ("band", "encoded"):
                    image += response.band.pixels if part == "band" else response.encoded.data
            close_image()
            return "OK", results
        except grpc.RpcError as error:
            close_image()
            return error.code().name, results
        finally:
            for _ in messages:  # so that requests() ends
                room.put(None)

    def session(self, frames: range, settings, change=None, **opening):
        """A session over the procedural sequence; `change` is (sequence, settings)."""
        v1, messages = self.v1, []
        for sequence in frames:
            if change and sequence == change[0]:
                new = v1.SettingsChange(from_sequence=sequence, settings=change[1])
                messages.append(v1.StreamRequest(change=new))
            messages += self.frame_messages(self.frames[sequence], v1.StreamRequest, sequence)
        return self.stream(messages, settings=settings, **opening)


def outcome_of(status: str, results) -> Outcome:
    values = {f"[{i}].{name}": what for i, (values, _, _) in enumerate(results) for name, what in values.items()}
    return Outcome(status, digest(" ".join(image for _, image, _ in results).encode()), values)


def tokens(client: Client, **opening) -> Outcome:
    """A session with tokens, a change of its settings at frame 6, and another session that continues from frame 3's token."""
    v1 = client.v1
    before = v1.Settings(curve=v1.TONE_CURVE_AGX)
    after = v1.Settings(curve=v1.TONE_CURVE_HABLE, exposure=v1.Exposure(compensation_ev=0.5))
    status, results = client.session(range(10), before, (6, after), **opening)
    if status != "OK":
        return outcome_of(status, results)
    again_status, again = client.session(range(4, 10), before, (6, after), resume_token=results[3][2], **opening)
    return outcome_of(f"{status} {again_status}", results + again)


def token_cases(v1) -> list[Case]:
    kinds = {"plain": {}, "look-ahead and cuts": {"lookahead": 3, "cut_threshold_ev": 0.5},
             "png": {"encoding": v1.ENCODING_PNG}, "jpeg": {"encoding": v1.ENCODING_JPEG, "jpeg_quality": 50}}
    return [Case(f"tokens, {name}", True, call=lambda client, name=name, kind=kind: tokens(
        client, session=f"net-{name.replace(' ', '-')}", **kind)) for name, kind in kinds.items()]
