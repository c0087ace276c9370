"""What comes back of a session's frame."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import render_pb2 as pb
from ._error import Error

Pixels = Any  # an array (h, w, 4), the bytes of a file, or None


@dataclass(frozen=True)
class Result:
    """Of one frame.

    sequence: the frame's number. image: an array (h, w, 4), the bytes of a PNG or JPEG file, or None if the encoding is "none"
    or the frame failed. info: exposure, target, statistics, stages and more; None if the frame failed. error: why it failed.
    """

    sequence: int
    image: Pixels
    info: pb.ResultHeader | None
    error: Error | None = None

    def get(self) -> tuple[Pixels, pb.ResultHeader]:
        """The image and its info. Raises the frame's error."""
        if self.info is None:
            raise self.error or AssertionError()
        return self.image, self.info
