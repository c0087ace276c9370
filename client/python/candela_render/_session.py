"""A session: frames go in, and their results come back in the same order."""
from __future__ import annotations

import secrets
import threading
import weakref
from typing import Any, Iterable, Iterator, Literal

import numpy

from . import render_pb2 as pb
from ._baked_view import BakedView
from ._channel import Security, Servers, connect
from ._core import Core, Stats
from ._error import Error, invalid
from ._frame import View, make_frame
from ._log import Log
from ._messages import enum_number, settings_message
from ._result import Pixels, Result
from ._wire import Array, image_type
from .settings import Settings


class Session:
    """Renders frames with an exposure that adapts over their time, as in a film.

        with Session() as session:                    # a candelad of its own, or Session("unix:/run/candela.sock")
            for t, frame in frames:                   # (h, w, 3 or 4), float16 or float32, linear light, any strides
                image, info = session(frame, time=t)  # (h, w, 4) uint8

    If the server is lost, the session goes on with the next one, or with the same one when it is back, and sends the unfinished
    frames again. Every frame gets exactly one result, with the same bits.

    server: "HOST:PORT", "unix:PATH", or a list of them whose servers share their resume keys. None: candelad is started, as
        CANDELAD or PATH have it; all sessions of this process share it, and it ends with the process.
    settings: a Settings for all frames; single ones may also be given by their names, as in Session(curve="agx"), and a view of
        bake_view() as view=.
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

    Waits until a server has opened the session. Raises Error. Any thread may use a session; a fork of the process may not, and
    opens its own.
    """

    def __init__(self, server: Servers = None, *, settings: Settings | None = None, lookahead: int = 0,
                 cut_threshold_ev: float = 0, encoding: str = "raw", jpeg_quality: int = 0,
                 state: pb.SessionState | None = None, return_state: bool = False, security: Security = Security(),
                 resume_limit: float = 30, silence_limit: float = 300, ping_interval: float = 10, name: str | None = None,
                 transport: Literal["auto", "grpc", "memory"] = "auto", **changes: Any) -> None:
        self._settings, self._changes = settings, changes
        self._base = settings_message(settings, changes)
        self._newest: tuple[dict[str, Any], pb.Settings] = {}, self._base
        try:
            opening = pb.StreamOpen(session=name or f"python-{secrets.token_hex(8)}", lookahead=lookahead, state=state,
                                    cut_threshold_ev=cut_threshold_ev, jpeg_quality=jpeg_quality,
                                    return_state=return_state or state is not None,
                                    encoding=enum_number(encoding, pb.Encoding.DESCRIPTOR, "encoding"))
        except (TypeError, ValueError) as error:
            raise invalid(str(error)) from None
        self._opened = Core(connect(server, security, ping_interval), opening, Log(self._base, state), resume_limit,
                            silence_limit, transport)
        self._closed = weakref.finalize(self, self._opened.close)
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

        Waits while the server's window is full or two windows of results have not been taken; one thread that does both asks `ready`
        first, or uses stream(). copy: False if the frame stays as it is until its result has come.
        """
        settings = self._settings_with(changes)
        made = make_frame(frame, copy=copy, room=lambda shape, dtype: self._room(shape, dtype, settings), exposure=exposure,
                          timeout_ms=None if timeout is None else max(1, round(timeout * 1000)))
        core, header = self._core, made.header
        made.image_bytes = self._image_bytes(header.height, header.width, settings)
        with self._submitting, core.changed:
            core.wait(lambda: self._ready() and not core.finished and not core.ended and not core.held)
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
        room = self._room((height, width, 4), numpy.dtype(dtype), self._base)
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

    @property
    def _core(self) -> Core:
        """Taken before any lock."""
        return self._opened.of_this_process()

    def _settings_with(self, changes: dict[str, Any]) -> pb.Settings:
        """Those of the last frame are kept: to make them takes longer than all the rest of a small frame."""
        if not changes:
            return self._base
        newest, message = self._newest
        if changes != newest or not all(isinstance(one, (str, int, float, BakedView)) for one in changes.values()):
            message = settings_message(self._settings, {**self._changes, **changes})
            self._newest = changes, message
        return message

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
        """Once it is True, only a submission makes it False: one thread may ask, and then submit and take."""
        core = self._core
        unanswered = core.log.unanswered
        return core.finished or (unanswered < core.window and unanswered + len(core.results) < 2 * core.window)

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
