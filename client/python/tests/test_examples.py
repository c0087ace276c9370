"""Each example runs, and makes what it says. So do the five lines of docs/python.md and README."""
import csv
import os
import pathlib
import re
import subprocess
import sys
import unittest

import numpy
from support import Test, frames

PACKAGE = pathlib.Path(__file__).resolve().parents[1]


class Examples(Test):
    def example(self, name, *words):
        return subprocess.run([sys.executable, PACKAGE / "examples" / name, *words], cwd=self.folder, capture_output=True,
                              text=True, timeout=120)

    def png(self, name):
        data = pathlib.Path(self.folder, name).read_bytes()
        self.assertEqual(data[:8], b"\x89PNG\r\n\x1a\n")
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")

    def test_simulator(self):
        done = self.example("simulator.py", "log.csv", "1")
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(f"{self.folder}/log.csv") as file:
            exposures = [float(row["exposure_ev"]) for row in csv.DictReader(file)]
        self.assertEqual(len(exposures), 30)
        self.assertLess(exposures[-1], exposures[0])  # it is brighter outside

    def test_page(self):
        done = self.example("page.py", "page.png")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater(self.png("page.png")[0], 500)

    def test_progressive(self):
        done = self.example("progressive.py", "out.png", "6")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.png("out.png"), (320, 180))
        self.assertEqual(len(set(line.split()[-2] for line in done.stdout.splitlines()[3:])), 1)  # the exposure stays

    def test_folder(self):
        stack = numpy.stack(frames(6))
        stack[2, 1, 1] = numpy.inf
        numpy.save(f"{self.folder}/frames.npy", stack)
        done = self.example("folder.py", "frames.npy", "out")
        self.assertEqual(done.returncode, 1)
        self.assertIn("frame 2: ", done.stderr)
        self.assertEqual(sorted(os.listdir(f"{self.folder}/out")), [f"{n:04d}.png" for n in (0, 1, 3, 4, 5)])

    def test_the_pages_scripts(self):
        for page in ("README.md", "docs/python.md"):
            text = (PACKAGE.parents[1] / page).read_text()
            scripts = [block for block in re.findall(r"(?:^(?:    .*)?\n)+", text, re.M) if "import candela_render" in block]
            self.assertTrue(scripts, page)
            for script in scripts:
                program = re.sub("^    ", "", script, flags=re.M)
                done = subprocess.run([sys.executable, "-"], input=program, cwd=self.folder, capture_output=True, text=True,
                                      timeout=60)
                self.assertEqual(done.returncode, 0, done.stderr)


if __name__ == "__main__":
    unittest.main()
