"""Sessions against the real candelad: bits, order, faults, and what is left behind."""
import asyncio
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
import unittest
import unittest.mock

import candela_render as candela
import numpy
from support import BIN, Test, frames


def rendered(session, all_frames, **settings):
    return [session(frame, time=n / 25, **settings)[0] for n, frame in enumerate(all_frames)]


def read_pam(data):
    """The images of a sequence of PAM files of 8 bits."""
    images = []
    while data:
        head, _, rest = data.partition(b"ENDHDR\n")
        fields = dict(line.split(maxsplit=1) for line in head.decode().splitlines() if " " in line)
        shape = int(fields["HEIGHT"]), int(fields["WIDTH"]), int(fields["DEPTH"])
        size = shape[0] * shape[1] * shape[2]
        images.append(numpy.frombuffer(rest[:size], numpy.uint8).reshape(shape))
        data = rest[size:]
    return images


class Frames(Test):
    def test_five_lines_have_the_bits_of_the_command(self):
        scene = frames(5)
        for n, frame in enumerate(scene):
            header = f"PF\n{frame.shape[1]} {frame.shape[0]}\n-1.0\n".encode()
            pathlib.Path(self.folder, f"{n:04d}.pfm").write_bytes(header + frame[::-1].tobytes())
        made = subprocess.run([BIN / "candela", "stream", f"{self.folder}/%04d.pfm", "-", "--pipe", "pam", "--fps", "25", "--curve",
                               "agx"], check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout
        with candela.Session() as session:
            images = rendered(session, scene, curve="agx")
        expected = read_pam(made)
        self.assertEqual(len(expected), len(images))
        for image, other in zip(images, expected):
            self.assertEqual((image.shape, image.dtype), ((48, 64, 4), numpy.uint8))
            numpy.testing.assert_array_equal(image[..., :other.shape[2]], other)

    def test_any_strides_and_types_have_the_same_bits(self):
        scene = frames(1, components=4)[0]
        wide = numpy.zeros((48, 128, 5), numpy.float32)
        wide[:, ::2, 1:] = scene
        with candela.Session(exposure={"mode": "manual"}) as session:
            expected, info = session(scene, time=0)
            for n, other in enumerate([scene[..., :3], wide[:, ::2, 1:], scene.astype(numpy.float16), scene[::-1, ::-1][::-1, ::-1],
                                       numpy.asfortranarray(scene)]):
                numpy.testing.assert_array_equal(session(other, time=n)[0], expected)
        self.assertEqual(info.exposure, 1)

    def test_formats_and_files(self):
        scene = frames(1)[0]
        with candela.Session(output_format="rgba16") as session:
            self.assertEqual(session(scene, time=0)[0].dtype, numpy.uint16)
            half = session(scene, time=0, output_format="rgba16f", output_size={"width": 32})[0]
            self.assertEqual((half.dtype, half.shape), (numpy.float16, (24, 32, 4)))
        for encoding, begin in (("png", b"\x89PNG"), ("jpeg", b"\xff\xd8")):
            with candela.Session(encoding=encoding) as session:
                self.assertEqual(session(scene, time=0)[0][:len(begin)], begin)
        with candela.Session(encoding="none", return_state=True) as session:
            image, info = session(scene, time=3)
            self.assertIsNone(image)
            self.assertEqual(info.state.media_time_ns, 3_000_000_000)
        with candela.Session(state=info.state) as session, self.fails("INVALID_ARGUMENT", "3 s"):
            session(scene, time=2)

    def test_what_is_refused_says_why_and_the_session_goes_on(self):
        good = frames(1)[0]
        bad = good.copy()
        bad[3, 4] = numpy.nan
        with candela.Session(bad_values="reject") as session:
            with self.fails("INVALID_ARGUMENT", "(10, 10)"):
                session(numpy.zeros((10, 10), numpy.float32), time=0)
            with self.fails("INVALID_ARGUMENT", "float64"):
                session(numpy.zeros((10, 10, 3)), time=0)
            with self.fails("INVALID_ARGUMENT", "curve is 'no'; it is one of linear"):
                session(good, time=0, curve="no")
            with self.fails("INVALID_ARGUMENT", "bloom.intensity is 11; it must be between 0 and 10"):
                session(good, time=0, bloom={"intensity": 11})
            with self.fails("INVALID_ARGUMENT", "there is no brightness"):
                session(good, time=0, brightness=1)
            with self.fails("INVALID_ARGUMENT", "4"):
                session(bad, time=0)  # by the server, which names the pixel
            session(good, time=1)
            with self.fails("INVALID_ARGUMENT", "at least the previous frame's, 1 s"):
                session(good, time=0.5)
            session.cut()
            self.assertTrue(session(good, time=0.5)[1].cut)
            self.assertFalse(session(good, time=0.6)[1].cut)
        with self.fails("CANCELLED"):
            session(good, time=2)

    def test_lookahead_streams_and_refuses_calls(self):
        scene = frames(8)
        with candela.Session(lookahead=2) as session:
            with self.fails("FAILED_PRECONDITION", "lookahead=2"):
                session(scene[0], time=0)
            results = list(session.stream((n / 25, frame) for n, frame in enumerate(scene)))
        self.assertEqual([result.sequence for result in results], list(range(8)))
        self.assertTrue(all(result.error is None for result in results))

    def test_submit_waits_for_a_slow_taker(self):
        scene = frames(1)[0]
        sent = []

        def submit():
            for n in range(12):
                sent.append(session.submit(scene, time=n))
            session.finish()

        with candela.Session() as session:
            thread = threading.Thread(target=submit)
            thread.start()
            with session._core.changed:
                session._core.changed.wait_for(lambda: len(session._core.results) == 2 * session._core.window)
            self.assertFalse(session.ready)
            self.assertLess(len(sent), 12)
            self.assertEqual([result.sequence for result in session.results()], list(range(12)))
            thread.join()

    def test_a_session_that_is_ready_stays_so_when_results_come(self):
        scene = frames(1)[0]
        with candela.Session() as session:
            core = session._core
            for n in range(2 * core.window):
                self.assertTrue(session.ready)
                session.submit(scene, time=n)
                with core.changed:
                    core.changed.wait_for(lambda: len(core.results) == n + 1)
                self.assertEqual(session.ready, n + 1 < 2 * core.window)

    def test_asyncio_has_the_same_bits(self):
        scene = frames(6)
        with candela.Session() as session:
            expected = rendered(session, scene)

        async def pairs():
            for n, frame in enumerate(scene):
                yield n / 25, frame

        async def main():
            async with candela.AsyncSession() as session:
                calls = [(await session(frame, time=n / 25))[0] for n, frame in enumerate(scene)]
            async with candela.AsyncSession() as session:
                return calls, [result.image async for result in session.stream(pairs())]

        for images in asyncio.run(main()):
            numpy.testing.assert_array_equal(images, expected)


class Faults(Test):
    def test_after_kill_and_restart_the_bits_are_those_of_an_undisturbed_run(self):
        scene = frames(12)
        server = self.server()
        with candela.Session(server.address, curve="agx") as session:
            expected = rendered(session, scene)
        with candela.Session(server.address, curve="agx") as session:
            images = []
            for n, frame in enumerate(scene):
                if n in (4, 9):
                    server.kill()
                    server.start()
                images.append(session(frame, time=n / 25)[0])
            self.assertEqual(session.stats.resumes, 2)
        numpy.testing.assert_array_equal(images, expected)

    def test_frames_in_flight_are_sent_again_to_the_next_server(self):
        scene = frames(30, height=480, width=640, dtype=numpy.float16)
        one, two = self.server(), self.server("losing_candelad")
        two.kill()
        two.start("candelad")
        with candela.Session(two.address) as session:
            expected = rendered(session, scene)
        images = []
        with candela.Session([one.address, two.address]) as session:
            for result in session.stream((n / 25, frame) for n, frame in enumerate(scene)):
                images.append(result.get()[0])
                if result.sequence == 10:
                    one.process.kill()
            self.assertEqual(session.stats.server, two.address)
        numpy.testing.assert_array_equal(images, expected)

    def test_goes_on_when_the_server_drains(self):
        scene = frames(8)
        one = self.server()
        with candela.Session(one.address) as session:
            expected = rendered(session, scene)
        with candela.Session(one.address) as session:
            images = rendered(session, scene[:3])
            one.process.send_signal(signal.SIGTERM)
            one.process.wait()
            one.kill()
            one.start()
            images += [session(frame, time=(3 + n) / 25)[0] for n, frame in enumerate(scene[3:])]
            self.assertIn("UNAVAILABLE", str(session.stats.last_loss))
        numpy.testing.assert_array_equal(images, expected)

    def test_a_server_that_hangs_is_left(self):
        scene = frames(24)
        hanging, good = self.server("hanging_candelad"), self.server()
        with candela.Session(good.address) as session:
            expected = rendered(session, scene)
        with candela.Session([hanging.address, good.address], silence_limit=2) as session:
            images = rendered(session, scene)
        numpy.testing.assert_array_equal(images, expected)

    def test_an_idle_session_keeps_its_server(self):
        frame, late = frames(1)[0], 0.0

        class Later:
            @staticmethod
            def monotonic():
                return time.monotonic() + late

        with unittest.mock.patch("candela_render._call.time", Later), candela.Session() as session:
            for n in range(20):
                session(frame, time=n)
                late += 1000  # more than silence_limit
            self.assertEqual(session.stats.resumes, 0)

    def test_a_server_that_loses_its_device_is_left(self):
        scene = frames(24)
        losing, good = self.server("losing_candelad"), self.server()
        with candela.Session(good.address) as session:
            expected = rendered(session, scene)
        with candela.Session([losing.address, good.address]) as session:
            images = rendered(session, scene)
            self.assertEqual(session.stats.server, good.address)
        numpy.testing.assert_array_equal(images, expected)

    def test_the_own_server_is_started_again(self):
        from candela_render import _server
        scene = frames(6)
        with candela.Session() as session:
            expected = rendered(session, scene)
        with candela.Session() as session:
            images = rendered(session, scene[:3])
            _server._own._process.kill()
            images += [session(frame, time=(3 + n) / 25)[0] for n, frame in enumerate(scene[3:])]
        numpy.testing.assert_array_equal(images, expected)

    def test_no_server_is_an_error_at_once(self):
        with self.fails("UNAVAILABLE", "cannot reach a server at unix:"):
            candela.Session(f"unix:{self.folder}/none")
        with self.fails("UNAVAILABLE", "127.0.0.1:1"):
            candela.render(frames(1)[0], server="127.0.0.1:1")

    def test_a_full_server_is_asked_again_and_says_when(self):
        server = self.server(options=["--max-sessions", "1"])
        with candela.Session(server.address), self.fails("UNAVAILABLE", "no server opens the session within 0.3 s") as failed:
            candela.Session(server.address, resume_limit=0.3)
        self.assertGreater(failed.exception.retry_delay, 0)

    def test_a_session_gives_up_after_its_limit(self):
        server = self.server()
        with candela.Session(server.address, resume_limit=0.3) as session:
            server.process.kill()
            server.process.wait()
            with self.fails("UNAVAILABLE", "no server has taken the session on for 0.3 s"):
                session(frames(1)[0], time=0)


def runs_candelad(pid):
    try:
        return "candelad" in pathlib.Path(f"/proc/{pid}/cmdline").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


# Each prints the folder of its server and ends in another way.
ENDS = {
    "normally": "",
    "with an exception": "raise RuntimeError",
    "by Ctrl-C": "import signal; signal.raise_signal(signal.SIGINT)",
    "with a session open and frames on their way": "s = candela.Session(); s.submit(f, time=0); sys.exit()",
    "by kill": "os.kill(os.getpid(), 9)",
}


class Leftovers(Test):
    def test_no_process_and_no_file_is_left_however_a_program_ends(self):
        for how, line in ENDS.items():
            with self.subTest(how):
                program = f"""
import os, sys, numpy, candela_render as candela
from candela_render import _server
f = numpy.ones((8, 8, 3), numpy.float32)
with candela.Session() as session:
    session(f, time=0)
    print(_server._own._process.pid, _server._own._folder, flush=True)
    {line}
"""
                # The watcher holds the pipe of stderr, too: it is at its end when both are.
                done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
                pid, folder = done.stdout.split()
                self.assertFalse(os.path.exists(folder))
                until = time.monotonic() + 30  # a kill takes effect later
                while runs_candelad(pid) and time.monotonic() < until:
                    time.sleep(0.01)
                self.assertFalse(runs_candelad(pid))

    def test_threads_end_with_their_session(self):
        before = threading.active_count()
        for _ in range(3):
            with candela.Session() as session:
                session(frames(1)[0], time=0)
        session = candela.Session()
        del session
        self.assertEqual([thread.name for thread in threading.enumerate() if thread.name.startswith("candela")], [])
        self.assertLessEqual(threading.active_count(), before + 1)

    def test_an_interrupted_call_leaves_the_session_usable(self):
        scene = frames(3)
        with candela.Session() as session:
            session(scene[0], time=0)
            take = session._take

            def interrupt():
                raise KeyboardInterrupt

            session._take = interrupt
            with self.assertRaises(KeyboardInterrupt):
                session(scene[1], time=1)
            session._take = take
            self.assertEqual(session(scene[2], time=2)[1].sequence, 2)


if __name__ == "__main__":
    unittest.main()
