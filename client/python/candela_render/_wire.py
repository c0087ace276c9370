"""Pixels on the wire: frames as bands of rows, and images from them."""
from __future__ import annotations

from typing import Any, Iterator

import numpy
from google.protobuf.internal.decoder import _DecodeVarint
from google.protobuf.internal.encoder import _VarintBytes
from numpy.typing import NDArray

from . import render_pb2 as pb
from ._error import invalid, protocol_error

Array = NDArray[Any]

MAX_BAND_BYTES = 2 << 20
MAX_SIDE = 16384  # pixels

_FORMATS = {(numpy.dtype(numpy.float16), 3): pb.PIXEL_FORMAT_RGB16F, (numpy.dtype(numpy.float16), 4): pb.PIXEL_FORMAT_RGBA16F,
            (numpy.dtype(numpy.float32), 3): pb.PIXEL_FORMAT_RGB32F, (numpy.dtype(numpy.float32), 4): pb.PIXEL_FORMAT_RGBA32F}
_IMAGES: dict[int, type] = {pb.OUTPUT_FORMAT_RGBA8: numpy.uint8, pb.OUTPUT_FORMAT_RGBA16: numpy.uint16,
                            pb.OUTPUT_FORMAT_RGBA16F: numpy.float16}


def pixel_format(array: Array) -> Any:
    """Of an array (h, w, 3 or 4). Raises Error if it is no frame."""
    if array.ndim != 3 or array.shape[2] not in (3, 4) or 0 in array.shape:
        raise invalid(f"the frame has the shape {array.shape}; it is (height, width, 3 or 4)")
    if max(array.shape[:2]) > MAX_SIDE:
        raise invalid(f"the frame has the shape {array.shape}; a side has at most {MAX_SIDE} pixels")
    found = _FORMATS.get((array.dtype, array.shape[2]))
    if found is None:
        raise invalid(f"the frame has the dtype {array.dtype}; it is float16 or float32")
    return found


def fill_rgba(room: Array, array: Array) -> Array:
    """Copies pixels (h, w, 3 or 4) to `room`, which is (h, w, 4)."""
    if array.shape[2] == 4:
        room[...] = array
        return room
    for component in range(3):  # numpy's loop over pixels is longer, and so faster, than one over three components
        room[..., component] = array[..., component]
    room[..., 3] = 1
    return room


def bands(pixels: Array, field: int) -> Iterator[bytes]:
    """The messages of a frame's rows, in C order. `field` is that of the band in the request. Copies the pixels once."""
    row_bytes = pixels[0].nbytes
    rows = max(1, MAX_BAND_BYTES // row_bytes)
    flat = pixels.data.cast("B")
    for first in range(0, len(pixels), rows):
        part = flat[first * row_bytes:(first + rows) * row_bytes]
        head = pb.Band(first_row=first).SerializeToString() + b"\x12" + _VarintBytes(len(part))
        yield b"".join((bytes((field << 3 | 2,)), _VarintBytes(len(head) + len(part)), head, part))


def band_of(message: bytes, field: int) -> tuple[int, memoryview] | None:
    """The first row and the pixels of a response that is a band, without a copy. protobuf's parser copies them twice."""
    if message[:1] != bytes((field << 3 | 2,)):
        return None
    try:
        size, at = _DecodeVarint(message, 1)
        first, end = 0, at + size
        while at < end:
            tag = message[at]
            value, at = _DecodeVarint(message, at + 1)
            if tag == 0x08:
                first = value
            elif tag == 0x12 and at + value == end == len(message):
                return first, memoryview(message)[at:]
            else:
                break
    except IndexError:
        pass
    raise protocol_error("a band that cannot be read")


class ImageReader:
    """Puts bands together. The memory is taken when the header has said a size that is within the limits."""

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        self.image: Array = numpy.empty(shape, dtype)
        self._flat = self.image.data.cast("B")
        self._row_bytes = self.image[0].nbytes
        self._at = 0

    def take(self, first_row: int, pixels: memoryview | bytes) -> bool:
        """Returns whether the image is whole."""
        end = self._at + len(pixels)
        if first_row * self._row_bytes != self._at or len(pixels) % self._row_bytes or not pixels or end > len(self._flat):
            raise protocol_error("a band does not continue the image")
        self._flat[self._at:end] = pixels
        self._at = end
        return end == len(self._flat)


def image_type(header: pb.ResultHeader | pb.Settings) -> Any:
    """numpy's, of a result or of settings. None: it is unknown."""
    if isinstance(header, pb.ResultHeader):
        return _IMAGES.get(header.format)
    hdr = header.transfer in (pb.TRANSFER_PQ, pb.TRANSFER_HLG)
    return _IMAGES.get(header.output_format or (pb.OUTPUT_FORMAT_RGBA16 if hdr else pb.OUTPUT_FORMAT_RGBA8))


def image_reader(header: pb.ResultHeader) -> ImageReader:
    dtype = image_type(header)
    if dtype is None or not (0 < header.width <= MAX_SIDE and 0 < header.height <= MAX_SIDE):
        raise protocol_error(f"an image of {header.width}x{header.height} in the format {header.format}")
    return ImageReader((header.height, header.width, 4), dtype)
