"""Memory that a session shares with a server on the same host, by the protocol of docs/transport.md."""
from __future__ import annotations

import contextlib
import fcntl
import mmap
import os
import socket
import threading
from typing import Any

import numpy

from . import render_pb2 as pb
from ._error import Error
from ._wire import Array

ALIGNMENT = 64  # bytes
MAX_BYTES = 1 << 31
ANSWER_LIMIT = 10.0  # s
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL


class Area:
    """A part of a region, which is free again when no array over it is left."""

    def __init__(self, region: Region, offset: int, free: list[int]) -> None:
        self.region, self.offset, self._free = region, offset, free

    def __del__(self) -> None:
        self._free.append(self.offset)

    def array(self, shape: tuple[int, ...], dtype: Any) -> Array:
        self.__array_interface__ = {"version": 3, "shape": shape, "typestr": numpy.dtype(dtype).str,
                                    "data": (self.region.start + self.offset, False)}
        return numpy.asarray(self)


def area_of(array: Array | None) -> Area | None:
    """The area that the array fills from its start."""
    area = array.base if array is not None else None
    if not isinstance(area, Area) or array is None or array.ctypes.data != area.region.start + area.offset:
        return None
    return area


class Region:
    """Areas for `count` frames and for as many images and two more, which the program may hold."""

    def __init__(self, path: str, frame_bytes: int, image_bytes: int, count: int) -> None:
        self.frame_bytes, self.image_bytes = (-(-size // ALIGNMENT) * ALIGNMENT for size in (frame_bytes, image_bytes))
        size = self.frame_bytes * count + self.image_bytes * (count + 2)
        if size > MAX_BYTES:
            raise Error("RESOURCE_EXHAUSTED", f"a region has {size} bytes; it has at most {MAX_BYTES}")
        with contextlib.ExitStack() as stack:
            file = os.memfd_create("candela", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
            stack.callback(os.close, file)
            os.ftruncate(file, size)
            fcntl.fcntl(file, fcntl.F_ADD_SEALS, _SEALS)
            memory = mmap.mmap(file, size, mmap.MAP_SHARED | mmap.MAP_POPULATE)
            door = stack.enter_context(socket.socket(socket.AF_UNIX))
            door.settimeout(ANSWER_LIMIT)
            door.connect(path)
            socket.send_fds(door, [b"\x01"], [file])
            answer = door.recv(256)
            while 0 < len(answer) < 17 and answer[0] == 0:
                part = door.recv(17 - len(answer))
                if not part:
                    break
                answer += part
            if len(answer) != 17 or answer[0] != 0:
                raise Error("UNAVAILABLE", f"{path} takes no memory: {answer[1:].decode(errors='replace')}")
            self.ticket = answer[1:]
            stack.pop_all()
        os.close(file)  # the map keeps it
        self._door = door
        self._bytes = numpy.frombuffer(memory, numpy.uint8)
        self.start: int = self._bytes.ctypes.data
        self.frames = [n * self.frame_bytes for n in range(count)]
        self.images = [count * self.frame_bytes + n * self.image_bytes for n in range(count + 2)]

    def close(self) -> None:
        """The server forgets it. Arrays over it stay."""
        self._door.close()


def _take(region: Region, free: list[int]) -> Area | None:
    try:
        return Area(region, free.pop(), free)
    except IndexError:
        return None


class Memory:
    """Of one call. After it no area of an image may be used again, because its frame may still be drawn: so its regions end
    with it. Any thread."""

    def __init__(self, address: str, required: bool) -> None:
        self._path = address.removeprefix("unix:") + ".memory"
        self._required = required
        self._lock = threading.Lock()
        self._regions: list[Region] = []
        self._over = False

    def frame(self, shape: tuple[int, ...], dtype: Any, image_bytes: int, window: int) -> Array | None:
        """An array to fill, for a frame whose image has so many bytes. None: there is no memory to share, or none is free."""
        size = shape[0] * shape[1] * shape[2] * numpy.dtype(dtype).itemsize
        with self._lock:
            region = self._regions[-1] if self._regions else None
            if region is None or region.frame_bytes < size or region.image_bytes < image_bytes:
                region = self._make(size, image_bytes, window)
            area = _take(region, region.frames) if region is not None else None
        return area.array(shape, dtype) if area is not None else None

    def _make(self, frame_bytes: int, image_bytes: int, window: int) -> Region | None:
        if self._over:
            return None
        try:
            self._regions.append(Region(self._path, frame_bytes, image_bytes, window + 1))
        except (Error, OSError) as error:
            self._over = True
            if self._required:
                raise Error("UNAVAILABLE", f"no memory can be shared with the server: {error}") from None
            return None
        return self._regions[-1]

    def place(self, header: pb.FrameHeader, pixels: Array | None, image_bytes: int) -> tuple[bool, Area | None]:
        """Says in the header where pixels and image lie. Returns whether the pixels are there, and the area for the image."""
        area = area_of(pixels)
        with self._lock:
            if area is None or area.region not in self._regions:
                return False, None
            header.memory.ticket = area.region.ticket
            header.memory.pixels_offset = area.offset
            image = _take(area.region, area.region.images) if 0 < image_bytes <= area.region.image_bytes else None
        if image is not None:
            header.memory.image_offset = image.offset
        return True, image

    def close(self) -> None:
        with self._lock:
            self._over = True
            for region in self._regions:
                region.close()
            self._regions.clear()  # gRPC's thread may hold the call a little longer
