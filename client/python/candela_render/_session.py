"""A session: frames go in, and their results come back in the same order."""
from __future__ import annotations

import collections
import secrets
import threading
import time as clock
import weakref
from dataclasses import dataclass
from typing import Any, Iterable, Iterator, Literal

import numpy

from . import render_pb2 as pb
from ._call import Call
from ._channel import Connection, Security, Servers, connect
from ._error import Error, invalid
from ._frame import View, make_frame
from ._log import Log
from ._memory import Memory
from ._messages import enum_number, settings_message
from ._result import Pixels, Result
from ._retry import Schedule
from ._wire import Array, image_type
from .settings import Settings


@dataclass
class Stats:
    """server: the current or the last one. resumes: how often the session went on with a new call. last_loss: why the last call
    was lost. mixed_bits: its servers differ in DeviceInfo.bits, so images may differ in bits."""

    server: str = ""
    resumes: int = 0
    last_loss: Error | None = None
    mixed_bits: bool = False


class Core:
    """What the callers share with the thread that drives the calls. `changed` guards all of it."""

    def __init__(self, connections: list[Connection], opening: pb.StreamOpen, log: Log, resume_limit: float,
                 silence_limit: float, transport: str) -> None:
        self.changed = threading.Condition()
        self.connections, self.log, self.silence_limit = connections, log, silence_limit
        self.name, self.lookahead, self.encoding = opening.session, opening.lookahead, opening.encoding
        self.wants_state = opening.return_state
        self._opening, self._resume_limit = opening, resume_limit
        self.was_open = self.finished = self.cancelled = self.ended = False
        self.end: Error | None = None
        self.window = 1
        self.transport = transport
        self.memory: Memory | None = None  # of the current call
        self.results: collections.deque[Result] = collections.deque()
        self.dropped: set[int] = set()  # frames whose callers have been interrupted
        self.stats = Stats()
        self._lost: float | None = None  # since when there have been no results
        self._bits = ""
        self._thread = threading.Thread(target=self._drive, name="candela-session", daemon=True)
        self._thread.start()

    # For the calls, with the lock.

    def open_request(self) -> pb.StreamRequest:
        opening = pb.StreamOpen()
        opening.CopyFrom(self._opening)
        opening.settings.CopyFrom(self.log.settings)
        if self.log.token:
            opening.resume_token = self.log.token
            opening.ClearField("state")
        return pb.StreamRequest(open=opening)

    def opened(self, opened: pb.StreamOpened) -> bool:
        self.window = max(1, opened.max_frames_in_flight) + self.lookahead
        self.stats.resumes += self.was_open
        self.stats.mixed_bits |= bool(self._bits and opened.bits and self._bits != opened.bits)
        self._bits = opened.bits or self._bits
        self.was_open = True
        if not self.log.unanswered:
            self._lost = None
        self.changed.notify_all()
        return not self.log.unanswered

    def answered(self, result: Result, token: bytes) -> None:
        self.log.answered(token)
        if result.sequence in self.dropped:
            self.dropped.remove(result.sequence)
        else:
            self.results.append(result)
        self._lost = None
        self.changed.notify_all()

    # For the callers.

    def wait(self, until: Any) -> None:
        """With the lock. Raises what ended the session."""
        self.changed.wait_for(lambda: self.ended or until())
        if not until():
            raise self.end or Error("FAILED_PRECONDITION", "the session has ended; open another one for more frames")

    def close(self) -> None:
        with self.changed:
            self.cancelled = True
            self.changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join()
        for connection in self.connections:
            connection.close()

    # The thread.

    def _drive(self) -> None:
        try:
            end = self._calls()
        except Error as error:
            end = error
        except BaseException as error:  # callers must not wait for ever
            end = Error("INTERNAL", f"{type(error).__name__}: {error}")
        with self.changed:
            self.ended, self.end = True, end
            self.changed.notify_all()

    def _calls(self) -> Error | None:
        schedule = Schedule(len(self.connections))
        asked = False
        put: set[str] = set()
        refusal: Error | None = None  # of the last server that was reached
        open_by = 0.0
        while self._wait_for_need(schedule.when):
            connection = self.connections[schedule.next]
            self.stats.server = connection.address
            with self.changed:
                self.log.rewind()
            call = Call(self, connection, asked)
            end = call.run()
            asked |= end.error is not None and end.error.reached
            error, resume = end.error, end.resume
            if error is None:
                return None
            if call.progress:
                put.clear()
            if error.code == "NOT_FOUND":
                try:
                    if self._put_environments(connection, put):
                        continue
                    resume = bool(put)  # it had them all, and has lost one again
                except Error as failed:
                    error, resume = failed, failed.code == "UNAVAILABLE"
            put.clear()
            if not resume:
                return error
            schedule.failed(error.retry_delay or 0, call.progress)
            self.stats.last_loss = error
            if self.was_open:
                self._lost = self._lost or clock.monotonic()
                continue
            if error.reached:
                open_by = open_by or clock.monotonic() + self._resume_limit
                refusal = error
            if schedule.round_over:
                if refusal is None or self._resume_limit <= 0:
                    return refusal or error
                if schedule.when >= open_by:
                    return Error("UNAVAILABLE", f"no server opens the session within {self._resume_limit:g} s: "
                                 f"{refusal.message}", refusal.retry_delay)
        return None

    def _wait_for_need(self, when: float) -> bool:
        """Until a call is needed, and not before `when`. Returns False if none will be. A session that has lost its server while
        no result was due needs none until it has something to send. Frames that look-ahead holds back are not due."""
        with self.changed:
            if not self._needs_server():
                self.changed.wait_for(self._needs_server)
                self._lost = clock.monotonic() if self._lost is not None else None
            until = when if self._lost is None else min(when, self._lost + self._resume_limit)
            self.changed.wait_for(lambda: self.cancelled, max(0.0, until - clock.monotonic()))
            if self.cancelled:
                raise Error("CANCELLED", "the session was closed")
            if self.was_open and self.finished and not self.log.unanswered:
                return False
            if self._lost is not None and clock.monotonic() >= self._lost + self._resume_limit:
                loss = self.stats.last_loss
                raise Error("UNAVAILABLE", f"no server has taken the session on for {self._resume_limit:g} s: "
                            f"{loss.message if loss else ''}", loss.retry_delay if loss else None)
            return True

    def _needs_server(self) -> bool:
        return self.cancelled or not self.was_open or self.finished or self.log.unanswered > self.lookahead

    def _put_environments(self, connection: Connection, put: set[str]) -> bool:
        """Puts those of all views without a result that are not in `put`. Returns whether there were any."""
        with self.changed:
            found = [frame.environment for frame in self.log.environments()]
        missing = {one.id: one for one in found if one is not None and one.id not in put}
        for one in missing.values():
            one._put_on(connection)
            put.add(one.id)
        return bool(missing)


class Session:
    """Renders frames with an exposure that adapts over their time, as in a film.

        with Session() as session:                    # a candelad of its own, or Session("unix:/run/candela.sock")
            for t, frame in frames:                   # (h, w, 3 or 4), float16 or float32, linear light, any strides
                image, info = session(frame, time=t)  # (h, w, 4) uint8

    If the server is lost, the session goes on with the next one, or with the same one when it is back, and sends the unfinished
    frames again. Every frame gets exactly one result, with the same bits.

    server: "HOST:PORT", "unix:PATH", or a list of them whose servers share their resume keys. None: candelad is started, as
        CANDELAD or PATH have it; all sessions of this process share it, and it ends with the process.
    settings: a Settings for all frames; single ones may also be given by their names, as in Session(curve="agx").
    lookahead: later frames that auto exposure takes into account, 0 .. 16. Results come as many frames later.
    cut_threshold_ev: a frame whose picture differs from the one before by more than this begins a scene; 0: none does by itself.
    encoding: "raw" for arrays, "png" or "jpeg" for the bytes of files, "none" to meter only.
    jpeg_quality: 1 .. 100; 0: the server's default.
    state: info.state of another session's result, whose exposure this one continues.
    return_state: info.state is set.
    resume_limit: seconds without results after a loss until the session gives up; also how long a full server is asked again.
    silence_limit: seconds after which a server that owes a result and says nothing counts as lost.
    ping_interval: seconds of silence after which the server is pinged.
    transport: how pixels go to a server at a unix socket: "memory" that both share, "grpc", or "auto": memory where it has it.
    name: 1 .. 64 letters, digits, dots, dashes and underscores. None: a random one.

    Waits until a server has opened the session. Raises Error. Any thread may use a session.
    """

    def __init__(self, server: Servers = None, *, settings: Settings | None = None, lookahead: int = 0,
                 cut_threshold_ev: float = 0, encoding: str = "raw", jpeg_quality: int = 0,
                 state: pb.SessionState | None = None, return_state: bool = False, security: Security = Security(),
                 resume_limit: float = 30, silence_limit: float = 300, ping_interval: float = 10, name: str | None = None,
                 transport: Literal["auto", "grpc", "memory"] = "auto", **changes: Any) -> None:
        self._settings, self._changes = settings, changes
        message = settings_message(settings, changes)
        try:
            opening = pb.StreamOpen(session=name or f"python-{secrets.token_hex(8)}", lookahead=lookahead, state=state,
                                    cut_threshold_ev=cut_threshold_ev, jpeg_quality=jpeg_quality,
                                    return_state=return_state or state is not None,
                                    encoding=enum_number(encoding, pb.Encoding.DESCRIPTOR, "encoding"))
        except (TypeError, ValueError) as error:
            raise invalid(str(error)) from None
        self._core = Core(connect(server, security, ping_interval), opening, Log(message, state), resume_limit,
                          silence_limit, transport)
        self._closed = weakref.finalize(self, self._core.close)
        self._calling, self._submitting = threading.Lock(), threading.Lock()
        self._shift_ns = 0
        self._cut = False
        try:
            with self._core.changed:
                self._core.wait(lambda: self._core.was_open)
        except BaseException:
            self.close()
            raise

    def __call__(self, frame: Array | View, *, time: float, cut: bool = False, exposure: float | None = None,
                 timeout: float | None = None, sequence: int | None = None, **changes: Any) -> tuple[Pixels, pb.ResultHeader]:
        """Renders one frame and waits for its image.

        frame: (h, w, 3 or 4) float16 or float32, scene-linear, alpha associated; or a View. It must not change meanwhile.
        time: when it is shown, in seconds; not before the frame before it, except after cut().
        cut: a new scene begins, so that exposure jumps to its target.
        exposure: the factor to render with, 2^-40 .. 2^40, instead of the metered one.
        timeout: the frame fails if rendering has not begun after this many seconds.
        sequence: the frame's number, greater than the one before; None: one more.
        changes: settings of this frame alone, by name, as in curve="agx" or bloom={"intensity": 0}.

        Returns the image, (h, w, 4) of uint8, uint16 or float16 as the setting output_format says, or the bytes of a file; and
        its info: exposure, target, statistics and more. Raises Error; the session goes on if only the frame failed.
        """
        core = self._core
        if core.lookahead:
            raise Error("FAILED_PRECONDITION", f"a call waits for its own result, which lookahead={core.lookahead} holds back "
                        "until later frames are there; use stream(), or submit() and results()")
        with self._calling:
            return self._call(frame, time=time, cut=cut, exposure=exposure, timeout=timeout, sequence=sequence, **changes)

    def _call(self, frame: Array | View, **rest: Any) -> tuple[Pixels, pb.ResultHeader]:
        core = self._core
        with core.changed:
            if core.results or core.log.unanswered > len(core.dropped):
                raise Error("FAILED_PRECONDITION", "frames that were submitted have results to come; take them first, by results()")
        number: int | None = None
        try:
            number = self.submit(frame, copy=False, **rest)
            return self._take().get()
        except BaseException:
            with core.changed:
                if number is not None and core.log.holds(number):
                    core.dropped.add(number)
            raise

    def submit(self, frame: Array | View, *, time: float, cut: bool = False, exposure: float | None = None,
               timeout: float | None = None, sequence: int | None = None, copy: bool = True, **changes: Any) -> int:
        """Queues a frame and returns its number; the rest is as for a call. results() brings its result.

        Waits while the server's window is full or as many results have not been taken; one thread that does both asks `ready`
        first, or uses stream(). copy: False if the frame stays as it is until its result has come.
        """
        settings = settings_message(self._settings, {**self._changes, **changes})
        made = make_frame(frame, copy=copy, room=lambda shape, dtype: self._room(shape, dtype, settings), exposure=exposure,
                          timeout_ms=None if timeout is None else max(1, round(timeout * 1000)))
        core, header = self._core, made.header
        made.image_bytes = self._image_bytes(header.height, header.width, settings)
        with self._submitting, core.changed:
            core.wait(lambda: self._ready() and not core.finished and not core.ended)
            time_ns = round(time * 1e9)
            new_scene = cut or self._cut
            shift = self._shift_ns
            if self._cut and time_ns + shift < core.log.last_time_ns:
                shift = core.log.last_time_ns - time_ns
            header.cut = new_scene
            try:
                header.sequence = core.log.last_sequence + 1 if sequence is None else sequence
                header.media_time_ns = time_ns + shift
            except (TypeError, ValueError) as error:
                raise invalid(f"sequence is {sequence!r} and time is {time!r}: {error}") from None
            core.log.add(made, settings)
            self._cut, self._shift_ns = False, shift
            core.changed.notify_all()
            return int(header.sequence)

    def empty(self, height: int, width: int, dtype: Any = numpy.float16) -> Array:
        """An array (height, width, 4) to fill and to give to this session, which then copies nothing if memory is shared. It must
        not change until its result has come, and may be used again then."""
        settings = settings_message(self._settings, self._changes)
        room = self._room((height, width, 4), numpy.dtype(dtype), settings)
        return numpy.empty((height, width, 4), dtype) if room is None else room

    @property
    def ready(self) -> bool:
        """Whether submit() would not wait."""
        with self._core.changed:
            return self._ready() or self._core.ended

    def results(self) -> Iterator[Result]:
        """The results in the order of the frames, as they come: one each, failures among them. Ends after finish()."""
        while (result := self._next()) is not None:
            yield result

    def stream(self, frames: Iterable[tuple[float, Array | View]], **changes: Any) -> Iterator[Result]:
        """The results of all `frames`, which are pairs of time and frame; takes them when there is room, and finishes the session.
        A frame may be used again when the next one is taken."""
        for time, frame in frames:
            while not self.ready:
                yield self._take()
            self.submit(frame, time=time, **changes)
        self.finish()
        yield from self.results()

    def cut(self) -> None:
        """A new scene begins with the next frame, whose time may be any."""
        with self._core.changed:
            self._cut = True

    def finish(self) -> None:
        """No more frames follow. Those that were submitted still get their results."""
        with self._core.changed:
            self._core.finished = True
            self._core.changed.notify_all()

    def close(self) -> None:
        """Ends the session at once. Threads that wait in it get Error with the code CANCELLED."""
        self._closed()

    @property
    def stats(self) -> Stats:
        return self._core.stats

    @property
    def name(self) -> str:
        return self._core.name

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _room(self, shape: tuple[int, int, int], dtype: Any, settings: pb.Settings) -> Array | None:
        memory = self._core.memory
        if memory is None:
            return None
        return memory.frame(shape, dtype, self._image_bytes(shape[0], shape[1], settings), self._core.window)

    def _image_bytes(self, height: int, width: int, settings: pb.Settings) -> int:
        """Of an image that may go through shared memory. 0: it is a file, or has a size of its own."""
        if self._core.encoding not in (pb.ENCODING_RAW, pb.ENCODING_UNSPECIFIED) or settings.HasField("output_size"):
            return 0
        return height * width * 4 * int(numpy.dtype(image_type(settings)).itemsize)

    def _ready(self) -> bool:
        core = self._core
        return core.finished or (core.log.unanswered < core.window and len(core.results) < core.window)

    def _next(self) -> Result | None:
        """None after the last one."""
        core = self._core
        with core.changed:
            core.changed.wait_for(lambda: core.results or core.ended)
            if core.results:
                core.changed.notify_all()
                return core.results.popleft()
            if core.end is not None:
                raise core.end
            return None

    def _take(self) -> Result:
        result = self._next()
        assert result is not None
        return result
