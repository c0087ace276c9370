"""Memory that a session shares with its server: the same bits, and areas that are used again. Skipped where the server has none."""
import gc
import os
import pathlib
import time
import unittest
import unittest.mock

import candela_render as candela
import numpy
from candela_render._memory import area_of
from support import Test, frames


class Memory(Test):
    def setUp(self):
        super().setUp()
        self.one = self.server()
        if not pathlib.Path(f"{self.one.socket}.memory").exists():
            self.skipTest("this candelad shares no memory")

    def run_session(self, transport, scene, **settings):
        """Copies of the images, and how many came through memory."""
        with candela.Session(self.one.address, transport=transport, **settings) as session:
            results = [session(frame, time=n / 25) for n, frame in enumerate(scene)]
            return [image.copy() for image, _ in results], sum(info.image_in_memory for _, info in results)

    def test_the_bits_are_those_of_grpc(self):
        for settings in ({}, {"output_format": "rgba16"}, {"output_format": "rgba16f"}, {"output_size": {"width": 31}}):
            for height, width, dtype, components in ((48, 64, numpy.float32, 3), (1, 1, numpy.float16, 4),
                                                     (33, 77, numpy.float16, 3), (270, 481, numpy.float32, 4)):
                scene = frames(4, height, width, dtype, components)
                expected, none = self.run_session("grpc", scene, **settings)
                images, shared = self.run_session("memory", scene, **settings)
                self.assertEqual((none, shared), (0, 0 if "output_size" in settings else 4))
                for image, other in zip(images, expected):
                    numpy.testing.assert_array_equal(image, other)

    def test_images_that_are_kept_stay_as_they_are(self):
        scene = frames(20)
        expected, _ = self.run_session("grpc", scene)
        with candela.Session(self.one.address, transport="memory") as session:
            kept = [session(frame, time=n / 25)[0] for n, frame in enumerate(scene)]
        self.one.kill()
        self.one.start()  # so that kill() at the end finds one
        gc.collect()
        numpy.testing.assert_array_equal(kept, expected)

    def test_filled_areas_are_not_copied_and_come_again(self):
        scene = frames(12, components=4, dtype=numpy.float16)
        expected, _ = self.run_session("grpc", scene)
        with candela.Session(self.one.address, transport="memory") as session:
            places = set()
            for n, frame in enumerate(scene):
                area = session.empty(48, 64)
                area[...] = frame
                places.add(area.ctypes.data)
                self.assertIsNotNone(area_of(area))
                numpy.testing.assert_array_equal(session(area, time=n / 25)[0], expected[n])
            self.assertLessEqual(len(places), 4)

    def test_after_kill_and_restart_the_bits_are_the_same(self):
        scene = frames(12)
        expected, _ = self.run_session("grpc", scene)
        with candela.Session(self.one.address) as session:
            images = []
            for n, frame in enumerate(scene):
                if n == 5:
                    self.one.kill()
                    self.one.socket.with_name(self.one.socket.name + ".memory").unlink(missing_ok=True)
                    self.one.start()
                image, info = session(frame, time=n / 25)
                images.append(image.copy())
                self.assertTrue(info.image_in_memory or n == 5)
        numpy.testing.assert_array_equal(images, expected)

    def test_a_server_that_is_lost_before_its_first_result_still_shares_memory_then(self):
        scene = frames(8)
        with candela.Session(self.one.address, lookahead=4) as session:
            for n, frame in enumerate(scene):
                if n == 3:
                    time.sleep(0.1)  # the frames before are on their way
                    self.one.kill()
                    self.one.socket.with_name(self.one.socket.name + ".memory").unlink(missing_ok=True)
                    self.one.start()
                session.submit(frame, time=n / 25)
            session.finish()
            infos = [result.get()[1] for result in session.results()]
            self.assertTrue(infos[-1].image_in_memory)
            self.assertEqual(session.stats.resumes, 1)

    def test_a_server_that_takes_no_memory_gets_bands(self):
        scene = frames(4)
        expected, _ = self.run_session("grpc", scene)
        from candela_render import _memory
        make = _memory.Region.__init__

        def unknown(region, *args):
            make(region, *args)
            region.ticket = bytes(16)

        with unittest.mock.patch.object(_memory.Region, "__init__", unknown):
            images, shared = self.run_session("auto", scene)
        self.assertEqual(shared, 0)
        numpy.testing.assert_array_equal(images, expected)

    def test_nothing_stays_mapped_or_open(self):
        self.run_session("memory", frames(3))  # what is loaded once
        gc.collect()
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(5):
            self.run_session("memory", frames(3))
        gc.collect()
        self.assertNotIn("memfd:candela", pathlib.Path("/proc/self/maps").read_text())
        self.assertLessEqual(len(os.listdir("/proc/self/fd")), before + 2)


class Without(Test):
    def test_a_server_without_it_is_named(self):
        server = self.server()
        pathlib.Path(f"{server.socket}.memory").unlink(missing_ok=True)
        with candela.Session(server.address, transport="memory") as session, self.fails("UNAVAILABLE", "no memory can be shared"):
            session(frames(1)[0], time=0)
        with candela.Session(server.address) as session:
            session(frames(1)[0], time=0)


if __name__ == "__main__":
    unittest.main()
