"""Panoramas that a server keeps as environments."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Iterator, Sequence

import grpc
import numpy

from . import render_pb2 as pb
from ._calls import BAND_FIELD, SERVICE, ask, unary
from ._channel import Connection, Security, Servers
from ._error import error_of, invalid, protocol_error
from ._frame import View
from ._messages import enum_number
from ._wire import Array, ImageReader, bands, fill_rgba, pixel_format
from .settings import Camera, Sphere

_PIXELS: dict[str, tuple[Any, Any]] = {"rgba16f": (pb.PIXEL_FORMAT_RGBA16F, numpy.float16),
                                       "rgba32f": (pb.PIXEL_FORMAT_RGBA32F, numpy.float32)}


@dataclass(frozen=True)
class Bake:
    """levels: for each roughness of header.levels an array (6, size, size, 4), faces +X -X +Y -Y +Z -Z. header.radiance_sh: 27
    numbers, l = 0 .. 2, m = -l .. l, red, green, blue of each."""

    levels: list[Array]
    header: pb.BakeHeader


class Environment:
    """An equirectangular panorama of linear light that the server keeps, for views and bakes. The server needs Vulkan.

    panorama: (h, w, 3 or 4) float16 or float32, up to 4096 x 8192; alpha is ignored. A copy is kept, so that a session can put it
        on another server.
    primaries: those of its R, G and B: "rec709", "rec2020", "p3-d65", "aces-ap0", "aces-ap1" or "xyz".
    server, security: as for Session, and the same as for the sessions that use it.

    id: 64 hex digits, the same on every server. info: default_cube_size, radiance_sh, counts of bad components.
    Raises Error; FAILED_PRECONDITION: the server has no Vulkan device.
    """

    def __init__(self, panorama: Array, server: Servers = None, *, primaries: str = "rec709", bad_values: str = "scrub",
                 security: Security = Security(), retry_limit: float = 30) -> None:
        array = numpy.asarray(panorama)
        pixel_format(array)  # raises
        self._pixels = fill_rgba(numpy.empty((*array.shape[:2], 4), array.dtype), array)
        self._start = pb.EnvironmentStart(format=pixel_format(self._pixels), height=array.shape[0], width=array.shape[1],
                                          input_primaries=enum_number(primaries, pb.Primaries.DESCRIPTOR, "primaries"),
                                          bad_values=enum_number(bad_values, pb.BadValues.DESCRIPTOR, "bad_values"))
        self._start.total_bytes = self._pixels.nbytes
        self._at: tuple[Servers, Security, float] = (server, security, retry_limit)
        self.info: pb.Environment = ask(*self._at, self._upload)
        self.id = self.info.id

    def view(self, width: int, height: int, camera: Camera | dict[str, object] | None = None,
             objects: Sequence[Sphere | dict[str, object]] = (), *, rotation_deg: float = 0, samples: int = 4) -> View:
        """A picture of it, which is a frame for render(), meter() and sessions.

        width, height: pixels. camera: fov_deg (vertical, 1 .. 170), yaw_deg, pitch_deg and more. objects: up to 64 spheres.
        rotation_deg: turns the environment about +Y, -360 .. 360. samples: rays a pixel at edges: 1, 4 or 16.
        """
        return View(self, width, height, camera or Camera(), objects, rotation_deg, samples)

    def bake(self, *, size: int = 0, levels: int = 0, rotation_deg: float = 0, pixels: str = "rgba16f", tier: str = "",
             verify: bool = False) -> Bake:
        """A cube map with specular levels.

        size: texels along a face of level 0, a power of two, 16 .. 4096; 0: by the panorama's width. levels: 0: all.
        pixels: "rgba16f" or "rgba32f". verify: header.levels have the error against the float64 reference.
        """
        format, dtype = _PIXELS.get(pixels) or (None, None)
        if dtype is None:
            raise invalid(f"pixels is {pixels!r}; it is one of {', '.join(_PIXELS)}")
        request = pb.BakeEnvironmentRequest(id=self.id, size=size, levels=levels, rotation_deg=rotation_deg, format=format,
                                            tier=tier, verify=verify)

        def once(server: Connection) -> Bake:
            call = server.channel.unary_stream(
                SERVICE + "BakeEnvironment", request_serializer=pb.BakeEnvironmentRequest.SerializeToString,
                response_deserializer=pb.BakeEnvironmentResponse.FromString)
            header: pb.BakeHeader | None = None
            faces: list[Array] = []
            face: ImageReader | None = None
            for response in call(request, metadata=server.begin()):
                part = response.WhichOneof("part")
                if part == "header" and header is None:
                    header = response.header
                elif part == "face" and header is not None and face is None and len(faces) < 6 * len(header.levels):
                    side = header.levels[len(faces) // 6].size
                    if not 0 < side <= 4096:
                        raise protocol_error("the size of a bake's level")
                    face = ImageReader((side, side, 4), dtype)
                elif part == "band" and face is not None:
                    if face.take(response.band.first_row, memoryview(response.band.pixels)):
                        faces.append(face.image)
                        face = None
                else:
                    raise protocol_error(f"an unexpected {part}")
            if header is None or len(faces) != 6 * len(header.levels):
                raise protocol_error("it ended before the last face")
            return Bake([numpy.stack(faces[at:at + 6]) for at in range(0, len(faces), 6)], header)

        return ask(*self._at, once)

    def drop(self) -> bool:
        """Frees it as soon as nobody uses it. Returns whether somebody still does."""
        request = pb.DropEnvironmentRequest(id=self.id)

        def once(server: Connection) -> bool:
            return bool(unary(server, SERVICE + "DropEnvironment", request, pb.DropEnvironmentResponse).in_use)

        return ask(*self._at, once)

    def _upload(self, server: Connection) -> pb.Environment:
        def request() -> Iterator[bytes]:
            yield pb.PutEnvironmentRequest(start=self._start).SerializeToString()
            yield from bands(self._pixels, BAND_FIELD)

        call: Any = server.channel.stream_unary(SERVICE + "PutEnvironment", response_deserializer=pb.Environment.FromString)
        answer: pb.Environment = call(request(), metadata=server.begin())
        return answer

    def _put_on(self, server: Connection) -> None:
        try:
            self._upload(server)
        except grpc.RpcError as failed:
            raise error_of(failed, server.address) from None
