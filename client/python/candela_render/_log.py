"""What a session has to send, until the server has confirmed it."""
from __future__ import annotations

import collections
from dataclasses import dataclass

from . import render_pb2 as pb
from ._error import invalid
from ._frame import Frame

MAX_TIME_NS = 2 ** 62


@dataclass
class Change:
    """Settings from a frame on."""

    from_sequence: int
    settings: pb.Settings


class Log:
    """Frames without a result, and changes of settings among them, in the order of their submission. `settings` and `token` are
    those with which a call begins: of the last result that came."""

    def __init__(self, settings: pb.Settings, state: pb.SessionState | None) -> None:
        self.settings = settings
        self.token = b""
        self.newest = settings  # those of the last frame
        self.last_sequence = state.sequence if state is not None else -1
        self.last_time_ns = state.media_time_ns if state is not None else 0
        self._steps: collections.deque[Frame | Change] = collections.deque()
        self._given = 0  # of _steps, to the current call
        self.unanswered = 0

    def add(self, frame: Frame, settings: pb.Settings) -> None:
        header = frame.header
        if header.sequence <= self.last_sequence:
            raise invalid(f"frame {header.sequence} comes after frame {self.last_sequence}; the sequence numbers of a session "
                          "must increase")
        if not self.last_time_ns <= header.media_time_ns <= MAX_TIME_NS:
            raise invalid(f"time is {header.media_time_ns * 1e-9:.9g} s; it must be at least the previous frame's, "
                          f"{self.last_time_ns * 1e-9:.9g} s; call cut() before a jump back")
        if settings is not self.newest and settings != self.newest:
            self._steps.append(Change(header.sequence, settings))
            self.newest = settings
        self._steps.append(frame)
        self.unanswered += 1
        self.last_sequence, self.last_time_ns = header.sequence, header.media_time_ns

    def rewind(self) -> None:
        """A new call gets all of it again."""
        self._given = 0

    def next(self) -> Frame | Change | None:
        if self._given == len(self._steps):
            return None
        self._given += 1
        return self._steps[self._given - 1]

    def due(self) -> Frame | None:
        """The frame whose result comes next, if the call has been given it."""
        for at, step in enumerate(self._steps):
            if isinstance(step, Frame):
                return step if at < self._given else None
        return None

    def holds(self, sequence: int) -> bool:
        """Whether the frame waits for its result."""
        return any(isinstance(step, Frame) and step.header.sequence == sequence for step in self._steps)

    def environments(self) -> list[Frame]:
        """The frames that are views."""
        return [step for step in self._steps if isinstance(step, Frame) and step.environment is not None]

    def answered(self, token: bytes) -> None:
        at = next(at for at, step in enumerate(self._steps) if isinstance(step, Frame))
        frame = self._steps[at]
        assert isinstance(frame, Frame) and at < self._given
        del self._steps[at]
        self._given -= 1
        self.unanswered -= 1
        if not token:
            return
        self.token = token
        while self._steps:
            first = self._steps[0]
            if not isinstance(first, Change) or first.from_sequence > frame.header.sequence:
                break
            self.settings = first.settings
            self._steps.popleft()
            self._given -= 1
