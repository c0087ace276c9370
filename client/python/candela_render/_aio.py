"""Sessions for asyncio: the same core, waited for on threads of their own."""
from __future__ import annotations

import asyncio
import concurrent.futures
import functools
from typing import Any, AsyncIterable, AsyncIterator, Callable, TypeVar

from . import render_pb2 as pb
from ._core import Stats
from ._frame import View
from ._result import Pixels, Result
from ._session import Session
from ._wire import Array

T = TypeVar("T")


class AsyncSession:
    """A Session whose calls are awaited; the arguments are the same.

        async with AsyncSession() as session:
            image, info = await session(frame, time=t)
            async for result in session.stream(frames):   # frames: an async iterator of pairs of time and frame
                ...
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._make = functools.partial(Session, *args, **kwargs)
        self._session: Session | None = None
        self._threads = concurrent.futures.ThreadPoolExecutor(2, "candela-async")  # one submits, one takes

    async def _wait(self, call: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._threads, call)

    async def __aenter__(self) -> AsyncSession:
        self._session = await self._wait(self._make)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._session is not None:
            await asyncio.get_running_loop().run_in_executor(None, self._session.close)  # lets both threads go
        self._threads.shutdown()

    @property
    def _open(self) -> Session:
        assert self._session is not None, "use it as `async with AsyncSession() as session`"
        self._session._core.of_this_process()  # a fork has none of the threads
        return self._session

    async def __call__(self, frame: Array | View, *, time: float, **rest: Any) -> tuple[Pixels, pb.ResultHeader]:
        """As Session's. Await one before the next."""
        return await self._wait(functools.partial(self._open, frame, time=time, **rest))

    async def submit(self, frame: Array | View, *, time: float, **rest: Any) -> int:
        return await self._wait(functools.partial(self._open.submit, frame, time=time, **rest))

    async def results(self) -> AsyncIterator[Result]:
        while (result := await self._wait(self._open._next)) is not None:
            yield result

    async def stream(self, frames: AsyncIterable[tuple[float, Array | View]], **changes: Any) -> AsyncIterator[Result]:
        """As Session's."""
        session = self._open
        async for time, frame in frames:
            while not session.ready:
                result = await self._wait(session._next)
                assert result is not None
                yield result
            await self.submit(frame, time=time, **changes)
        session.finish()
        async for result in self.results():
            yield result

    def cut(self) -> None:
        self._open.cut()

    def finish(self) -> None:
        self._open.finish()

    @property
    def stats(self) -> Stats:
        return self._open.stats
