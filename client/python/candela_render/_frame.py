"""Frames: arrays of pixels, or views of environments that the server draws."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Callable, Iterator, Sequence

import numpy

from . import render_pb2 as pb
from ._error import invalid
from ._memory import area_of
from ._messages import fill
from ._wire import Array, bands, fill_rgba, pixel_format
from .settings import Camera, Sphere

if TYPE_CHECKING:
    from ._environment import Environment


@dataclass(frozen=True)
class View:
    """A picture of an environment, in place of pixels. Environment.view() makes one.

    width, height: pixels. camera: where it looks. objects: up to 64 spheres. rotation_deg: turns the environment about +Y,
    -360 .. 360. samples: rays a pixel at the edges of objects: 1, 4 or 16.
    """

    environment: Environment
    width: int
    height: int
    camera: Camera | dict[str, object] = field(default_factory=Camera)
    objects: Sequence[Sphere | dict[str, object]] = ()
    rotation_deg: float = 0
    samples: int = 4

    def _message(self) -> pb.View:
        view = pb.View(environment=self.environment.id, rotation_deg=self.rotation_deg, samples=self.samples)
        view.camera.SetInParent()
        fill(view.camera, self.camera, "camera.")
        for one in self.objects:
            fill(view.objects.add(), one, "objects.")
        return view


@dataclass
class Frame:
    """What is sent of a frame, and kept until it has its result."""

    header: pb.FrameHeader
    pixels: Array | None  # (h, w, 3 or 4) in C order; (h, w, 4) in shared memory. None: the header has a view
    environment: Environment | None
    image_bytes: int = 0  # of the image that may be put into shared memory

    def bands(self, field_number: int) -> Iterator[bytes]:
        return bands(self.pixels, field_number) if self.pixels is not None else iter(())


Room = Callable[[tuple[int, int, int], Any], "Array | None"]  # an array to put pixels of this shape and type into


def make_frame(source: Array | View, *, copy: bool, room: Room | None = None, **header: Any) -> Frame:
    """Without `copy` the pixels may be those of `source`, which must then stay as they are. None leaves a field absent."""
    message = pb.FrameHeader()
    for name, value in header.items():
        if value is not None:
            try:
                setattr(message, name, value)
            except (TypeError, ValueError) as error:
                raise invalid(f"{name} is {value!r}: {error}") from None
    if isinstance(source, View):
        message.width, message.height = source.width, source.height
        message.view.CopyFrom(source._message())
        return Frame(message, None, source.environment)
    array = numpy.asarray(source)
    pixel_format(array)  # raises
    height, width, components = array.shape
    given = array.flags.c_contiguous and components == 4 and area_of(array) is not None
    place = room((height, width, 4), array.dtype) if room is not None and not given else None
    if place is not None:
        pixels = fill_rgba(place, array)
    elif given or not copy:
        pixels = numpy.ascontiguousarray(array)
    else:
        pixels = numpy.array(array, order="C")
    message.format, message.height, message.width, message.total_bytes = pixel_format(pixels), height, width, pixels.nbytes
    return Frame(message, pixels, None)
