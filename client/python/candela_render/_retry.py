"""Which of several servers to call next, and when; and single calls that are repeated."""
from __future__ import annotations

import random
import time
from typing import Callable, Sequence, TypeVar

import grpc

from ._channel import Connection
from ._error import Error, error_of

T = TypeVar("T")

FIRST_PAUSE, LONGEST_PAUSE = 0.05, 1.0  # s
MOST_JITTER = 0.5


class Schedule:
    """The servers are called in turn. The first round has no pauses; then they double, up to 1 s. Pauses, and the times that
    servers name, get up to half as much again at random, so that a crowd does not come back together."""

    def __init__(self, servers: int, clock: Callable[[], float] = time.monotonic, chance: random.Random | None = None) -> None:
        self._clock, self._chance = clock, chance or random.Random()
        self._not_before = [0.0] * servers
        self._attempts = 0  # calls since the last progress
        self.next = 0
        self.when = 0.0

    def failed(self, delay: float = 0, progress: bool = False) -> None:
        """The call of `next` failed now, and that server asks for a wait of `delay` seconds."""
        now, servers = self._clock(), len(self._not_before)
        self._attempts = 1 if progress else self._attempts + 1
        self._not_before[self.next] = now + self._jittered(delay)
        self.next = (self.next + 1) % servers
        self.when = now
        if self._attempts > 1 and self.round_over and self._attempts % servers == 0:
            rounds = min(self._attempts // servers - 1, 10)
            self.when += self._jittered(min(LONGEST_PAUSE, FIRST_PAUSE * 2 ** rounds))
        self.when = max(self.when, self._not_before[self.next])

    @property
    def round_over(self) -> bool:
        return self._attempts >= len(self._not_before)

    def _jittered(self, pause: float) -> float:
        return pause * self._chance.uniform(1, 1 + MOST_JITTER)


def retry(connections: Sequence[Connection], limit: float, call: Callable[[Connection], T]) -> T:
    """Makes one call, on the next server or later if a server is full, starting or draining, for `limit` seconds. If no server
    can be reached in the first round, that is the error."""
    schedule = Schedule(len(connections))
    refusal: Error | None = None
    until = 0.0
    while True:
        at = connections[schedule.next]
        try:
            return call(at)
        except grpc.RpcError as failed:
            error = error_of(failed, at.address)
        if error.code != "UNAVAILABLE":
            raise error
        if error.reached:
            until = until or time.monotonic() + limit
            refusal = error
        schedule.failed(error.retry_delay or 0)
        if not schedule.round_over:
            continue
        if refusal is None:
            raise error
        if schedule.when >= until:
            raise Error("UNAVAILABLE", f"no server takes the call within {limit:g} s: {refusal.message}", refusal.retry_delay)
        time.sleep(max(0.0, schedule.when - time.monotonic()))
