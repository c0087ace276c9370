"""One call of a session: frames go to one server, and results come back."""
from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Iterator

import grpc
import numpy

from . import render_pb2 as pb
from ._channel import Connection
from ._error import Error, error_of, protocol_error
from ._frame import Frame
from ._memory import Area, Memory
from ._result import Result
from ._wire import Array, ImageReader, band_of, image_reader, image_type

if TYPE_CHECKING:
    from ._core import Core

STREAM = "/candela.v1.RenderService/Stream"
OPEN_LIMIT = 10.0  # s; a server that does not answer the open message for this long is skipped
BAND_FIELD = 2  # in requests and responses
CODES = {code.value[0]: code.name for code in grpc.StatusCode}


class End(Exception):
    """How a call ended. error: None if all results came. resume: the session may go on with another call."""

    def __init__(self, error: Error | None, resume: bool) -> None:
        super().__init__(error)
        self.error, self.resume = error, resume


class Call:
    """`core` is the session's state; its lock guards what the threads here share."""

    def __init__(self, core: Core, connection: Connection, asked_before: bool) -> None:
        self._core, self._connection, self._asked_before = core, connection, asked_before
        self._opened = self._leaving = self._over = self._closed = self._writing = False
        self._owed = 0  # frames that were begun and have no result
        self._hangs: Error | None = None
        self.progress = False
        self._last_progress = time.monotonic()
        self._answered = False
        self._header: pb.ResultHeader | None = None  # of the image that is coming
        self._image: ImageReader | None = None
        self._file: bytearray | None = None
        self._grpc: Any = None
        self._areas: dict[int, Area] = {}  # for the images of frames on their way
        shares = core.transport != "grpc" and connection.address.startswith("unix:")
        self._memory = Memory(connection.address, core.transport == "memory") if shares else None
        self._shared = False

    def run(self) -> End:
        core = self._core
        stream = self._connection.channel.stream_stream(STREAM)
        try:
            metadata = [("x-session-id", core.name), *self._connection.begin()]
        except Error as error:
            return End(error, False)
        watch = threading.Thread(target=self._watch, name="candela-watch", daemon=True)
        self._grpc = stream(self._requests(), metadata=metadata)
        watch.start()
        try:
            for message in self._grpc:
                self._last_progress = time.monotonic()
                self._take(message)
            return self._ended_well()
        except grpc.RpcError as failed:
            return self._failed(failed)
        except Error as error:
            return End(error, False)
        finally:
            with core.changed:
                self._over = True
                core.changed.notify_all()
                core.memory = None
            self._grpc.cancel()
            watch.join()
            if self._memory is not None:
                self._memory.close()
                self._areas.clear()

    def _requests(self) -> Iterator[bytes]:
        """Runs on gRPC's thread."""
        core = self._core
        with core.changed:
            request = core.open_request()
        yield request.SerializeToString()
        while True:
            with core.changed:
                step = None
                while not self._over and not self._leaving:
                    if self._opened:
                        step = core.log.next()
                        if step is not None or core.finished:
                            break
                    core.changed.wait()
                if step is None:
                    self._closed = core.finished and not self._over and not self._leaving
                    if not self._leaving:
                        return
                    core.changed.wait_for(lambda: self._over)  # a half-close would be the end of the session
                    return
                self._writing = True
                self._owed += isinstance(step, Frame)
                self._last_progress = time.monotonic()  # the silence of an idle session is over
                core.changed.notify_all()  # _watch
            if isinstance(step, Frame):
                request = pb.StreamRequest(frame=step.header)
                placed = self._place(request.frame, step)
                yield request.SerializeToString()
                for band in step.bands(BAND_FIELD) if not placed else ():
                    self._last_progress = time.monotonic()
                    yield band
            else:
                change = pb.SettingsChange(from_sequence=step.from_sequence, settings=step.settings)
                yield pb.StreamRequest(change=change).SerializeToString()
            self._writing = False

    def _place(self, header: pb.FrameHeader, frame: Frame) -> bool:
        """Names the frame's memory in its header, if the server shares it. _requests() must hold none while it waits."""
        if self._memory is None:
            return False
        placed, area = self._memory.place(header, frame.pixels, frame.image_bytes)
        self._shared |= placed
        if area is not None:
            self._areas[frame.header.sequence] = area
        return placed

    def _watch(self) -> None:
        """Cancels the call if the session is cancelled, or if the server neither reads nor sends."""
        core = self._core
        with core.changed:
            while not self._over:
                limit: float | None = None
                if not self._opened:
                    limit = OPEN_LIMIT
                elif self._owed > (0 if self._writing or self._closed else core.lookahead):
                    limit = core.silence_limit
                left = None if limit is None else self._last_progress + limit - time.monotonic()
                if core.cancelled or (left is not None and left <= 0):
                    if not core.cancelled:
                        self._hangs = Error("UNAVAILABLE", f"no answer from {self._connection.address} within {limit:g} s: it "
                                            f"hangs{'' if self._opened else ' or is not a candelad'}")
                    self._grpc.cancel()
                    return
                core.changed.wait(left if left is not None else 60)

    def _take(self, message: bytes) -> None:
        band = band_of(message, BAND_FIELD)
        if band is not None:
            if self._image is None:
                raise protocol_error("an unexpected band")
            if self._image.take(*band):
                self._answer(self._image.image)
            return
        response = pb.StreamResponse.FromString(message)
        part = response.WhichOneof("part")
        if part == "encoded" and self._file is not None and self._header is not None:
            self._file += response.encoded.data
            if len(self._file) > self._header.encoded_bytes or not response.encoded.data:
                raise protocol_error("a part of a file that does not fit")
            if len(self._file) == self._header.encoded_bytes:
                self._answer(bytes(self._file))
        elif part == "opened" and not self._opened:
            with self._core.changed:
                self._opened = True
                self.progress = self._core.opened(response.opened)
                self._core.memory = self._memory
        elif part == "header" and self._opened and self._header is None:
            self._take_header(response.header)
        elif part == "failure" and self._opened and self._header is None:
            failure = response.failure
            self._due(failure.sequence)
            self._areas.pop(failure.sequence, None)
            self._put(failure.sequence, None, None, Error(CODES.get(failure.code, "UNKNOWN"), failure.message),
                      failure.resume_token)
        elif part == "go_away":
            with self._core.changed:
                self._leaving = True
                self._core.changed.notify_all()
        else:
            raise protocol_error(f"an unexpected {part}")

    def _due(self, sequence: int) -> Frame:
        with self._core.changed:
            due = self._core.log.due()
        if due is None or due.header.sequence != sequence:
            raise protocol_error(f"a result for frame {sequence}, which is not due")
        return due

    def _take_header(self, header: pb.ResultHeader) -> None:
        due = self._due(header.sequence)
        if due.header.HasField("exposure") and header.exposure != due.header.exposure:
            raise Error("UNIMPLEMENTED", "the server ignores the exposures of frames, because it is older than this client")
        if self._core.wants_state and not header.HasField("state"):
            raise Error("UNIMPLEMENTED", "the server ignores a session's state, because it is older than this client")
        self._header = header
        area = self._areas.pop(header.sequence, None)
        if self._core.encoding == pb.ENCODING_NONE:
            self._answer(None)
        elif header.image_in_memory:
            if area is None or image_type(header) is None or area.region.image_bytes < (
                    header.width * header.height * 4 * numpy.dtype(image_type(header)).itemsize):
                raise protocol_error("an image in memory that it was not given")
            self._answer(area.array((header.height, header.width, 4), image_type(header)))
        elif header.encoded_bytes > 0:
            if header.encoded_bytes > 16 * header.width * header.height + (1 << 17):
                raise protocol_error("an encoded image is larger than one can be")
            self._file = bytearray()
        else:
            self._image = image_reader(header)

    def _answer(self, image: Array | bytes | None) -> None:
        header = self._header
        assert header is not None
        token = header.resume_token
        header.ClearField("resume_token")
        self._header = self._image = self._file = None
        self._put(header.sequence, image, header, None, token)

    def _put(self, sequence: int, image: Array | bytes | None, header: pb.ResultHeader | None, error: Error | None,
             token: bytes) -> None:
        with self._core.changed:
            self._owed -= 1
            self.progress = self._answered = True
            self._core.answered(Result(sequence, image, header, error), token)

    def _ended_well(self) -> End:
        if self._closed and self._core.log.unanswered == 0:
            return End(None, False)
        how = "went away" if self._leaving else "ended before every frame had its result"
        return End(Error("UNAVAILABLE", f"{self._connection.address} {how}"), True)

    def _failed(self, failed: grpc.RpcError) -> End:
        if self._hangs is not None:
            return End(self._hangs, True)
        if self._core.cancelled:
            return End(Error("CANCELLED", "the session was closed"), False)
        error = error_of(failed, self._connection.address)
        # A server that takes no memory from here says so by ending the call. Only its own status says when to come back.
        if self._shared and not self._answered and not self._leaving and error.retry_delay and self._core.transport == "auto":
            self._core.transport = "grpc"
        code, was_open = error.code, self._core.was_open
        if self._closed and self._core.log.unanswered == 0 and code in ("UNAVAILABLE", "CANCELLED", "INTERNAL", "UNKNOWN"):
            return End(None, False)
        resume = (
            code in ("UNAVAILABLE", "CANCELLED")
            # The server has not noticed yet that it lost us.
            or (code == "ALREADY_EXISTS" and (was_open or self._asked_before))
            or (code == "INTERNAL" and "RST_STREAM" in error.message)
            or (code == "UNKNOWN" and ("Stream removed" in error.message or "No status received" in error.message))
            # Before the first result that may be this session's own previous call, if its open message came late.
            or (code == "ABORTED" and was_open and not self._answered)
            # The open message took longer than the server's idle timeout.
            or (code == "DEADLINE_EXCEEDED" and not self._opened))
        return End(error, resume)
