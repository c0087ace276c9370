"""A session's state, and the thread that makes its calls."""
from __future__ import annotations

import collections
import os
import threading
import time as clock
import weakref
from dataclasses import dataclass
from typing import Any

from . import render_pb2 as pb
from ._call import Call
from ._channel import Connection
from ._error import Error
from ._log import Log
from ._memory import Memory
from ._result import Result
from ._retry import Schedule


@dataclass
class Stats:
    """server: the current or the last one. resumes: how often the session went on with a new call. last_loss: why the last call
    was lost. mixed_bits: its servers differ in DeviceInfo.bits, so images may differ in bits."""

    server: str = ""
    resumes: int = 0
    last_loss: Error | None = None
    mixed_bits: bool = False


HOLD_LIMIT = 1.0  # s
_cores: weakref.WeakSet[Core] = weakref.WeakSet()  # of this process


class Core:
    """What the callers share with the thread that drives the calls. `changed` guards all of it."""

    def __init__(self, connections: list[Connection], opening: pb.StreamOpen, log: Log, resume_limit: float,
                 silence_limit: float, transport: str) -> None:
        self._process = os.getpid()
        self.changed = threading.Condition()
        self.held = False  # no frame may be submitted
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
        _cores.add(self)

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

    def of_this_process(self) -> Core:
        """Itself. Raises in a fork, where no thread makes its calls and any of its locks may stay locked."""
        if self._process != os.getpid():
            raise Error("FAILED_PRECONDITION", "this session belongs to the process that opened it, and this is a fork of that; "
                        "open one here, after the fork")
        return self

    def wait(self, until: Any) -> None:
        """With the lock. Raises what ended the session."""
        self.changed.wait_for(lambda: self.ended or until())
        if not until():
            raise self.end or Error("FAILED_PRECONDITION", "the session has ended; open another one for more frames")

    def close(self) -> None:
        if self._process != os.getpid():
            return  # it goes on in the process that opened it
        with self.changed:
            self.cancelled = True
            self.changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join()
        for connection in self.connections:
            connection.close()

    # For forks: gRPC's part in the child may wait for ever if a thread of the parent was busy in it.

    def hold(self) -> None:
        """Waits until the frames on their way have their results, for a while, and keeps the lock: all threads stop there."""
        self.changed.acquire()
        self.held = True
        self.changed.wait_for(lambda: self.ended or self.log.unanswered <= self.lookahead, HOLD_LIMIT)

    def let_go(self) -> None:
        self.held = False
        self.changed.notify_all()
        self.changed.release()

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


_forking = threading.Lock()
_held: list[Core] = []  # by the thread that forks


def _before_fork() -> None:
    _forking.acquire()
    _held.extend(_cores)
    for core in _held:
        core.hold()


def _after_fork() -> None:
    while _held:
        _held.pop().let_go()
    _forking.release()


def _in_child() -> None:
    global _forking
    _forking = threading.Lock()
    _held.clear()
    _cores.clear()


os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_in_child)
