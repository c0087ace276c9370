"""Forks of a process that has used the package: torch's DataLoader and multiprocessing's Pool make them on Linux."""
import multiprocessing
import os
import subprocess
import sys
import threading
import unittest

import candela_render as candela
from support import Test, frames

LIMIT = 30  # s


def in_fork(call, *args):
    """What the call returns in a forked child, or the error's code and message."""
    def child(answers):
        try:
            answers.put(call(*args))
        except candela.Error as error:
            answers.put((error.code, error.message))

    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    process = context.Process(target=child, args=(answers,))
    process.start()
    try:
        return answers.get(timeout=LIMIT)
    finally:
        process.kill()
        process.join()


def bytes_of(frame):
    return candela.render(frame)[0].tobytes()


def bytes_of_session(frame):
    with candela.Session() as session:
        return session(frame, time=0)[0].tobytes()


class Forks(Test):
    def test_a_child_renders_by_itself_and_the_parents_session_goes_on(self):
        frame = frames(1)[0]
        with candela.Session() as session:
            expected = session(frame, time=0)[0].tobytes()
            for call in (bytes_of, bytes_of_session):
                self.assertEqual(in_fork(call, frame), expected)
            self.assertEqual(session(frame, time=0)[0].tobytes(), expected)

    def test_a_child_renders_while_the_parents_session_does(self):
        frame = frames(1)[0]
        over = threading.Event()

        def render_on(session):
            time = 0
            while not over.is_set():
                session(frame, time=time)
                time += 1

        with candela.Session() as session:
            expected = candela.render(frame)[0].tobytes()
            thread = threading.Thread(target=render_on, args=(session,))
            thread.start()
            try:
                for _ in range(3):
                    self.assertEqual(in_fork(bytes_of, frame), expected)
            finally:
                over.set()
                thread.join()

    def test_a_busy_thread_does_not_hold_up_a_fork(self):
        frame = frames(1)[0]
        over = threading.Event()

        def be_busy():
            while not over.is_set():
                sum(range(1000))

        expected = candela.render(frame)[0].tobytes()
        thread = threading.Thread(target=be_busy)
        thread.start()
        try:
            self.assertEqual(in_fork(bytes_of, frame), expected)
        finally:
            over.set()
            thread.join()

    def test_the_parents_session_is_an_error_in_a_child_at_once(self):
        frame = frames(1)[0]
        with candela.Session() as session:
            # As if another thread of the parent held them.
            with session._calling, session._submitting, session._core.changed:
                for call in (lambda: session(frame, time=1)[0].tobytes(), lambda: session.submit(frame, time=1),
                             lambda: list(session.results()), session.cut, session.finish, lambda: session.ready):
                    code, message = in_fork(call)
                    self.assertEqual(code, "FAILED_PRECONDITION")
                    self.assertIn("open one here, after the fork", message)
                self.assertIsNone(in_fork(session.close), "it is the parent's to close")
            session(frame, time=1)

    def test_the_parents_async_session_is_an_error_in_a_child(self):
        program = """
            import asyncio, os, sys, numpy, candela_render as candela
            frame = numpy.ones((8, 8, 3), numpy.float32)
            async def main():
                async with candela.AsyncSession() as session:
                    await session(frame, time=0)
                    if os.fork() == 0:
                        try:
                            await session(frame, time=1)
                        except candela.Error as error:
                            os._exit(7 if error.code == "FAILED_PRECONDITION" else 1)
                        os._exit(1)
                    print(os.waitstatus_to_exitcode(os.wait()[1]))
            asyncio.run(main())
        """
        self.assertEqual(self.run_python(program), "7")

    def test_grpc_that_was_imported_without_support_is_an_error_and_no_hang(self):
        program = """
            import grpc, os, sys, numpy, candela_render as candela
            frame = numpy.ones((8, 8, 3), numpy.float32)
            candela.render(frame)
            if os.fork() == 0:
                try:
                    candela.render(frame)
                except candela.Error as error:
                    os.write(1, error.message.encode())
                os._exit(0)
            os.wait()
        """
        self.assertIn("import candela_render before grpc", self.run_python(program))

    def run_python(self, program):
        variables = {name: value for name, value in os.environ.items() if name != "GRPC_ENABLE_FORK_SUPPORT"}
        lines = [line[12:] for line in program.strip("\n").splitlines()]
        return subprocess.run([sys.executable, "-c", "\n".join(lines)], env=variables, stdout=subprocess.PIPE, text=True, check=True,
                              timeout=LIMIT).stdout.strip()
