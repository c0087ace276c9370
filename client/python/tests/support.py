"""Servers for the tests. CANDELA_BIN is the folder of the built programs."""
import contextlib
import os
import pathlib
import secrets
import subprocess
import tempfile
import unittest

import numpy

BIN = pathlib.Path(os.environ["CANDELA_BIN"])
os.environ["CANDELAD"] = str(BIN / "candelad")


class Server:
    """candelad at a unix socket, which may be killed and started again."""

    def __init__(self, folder, name="candelad", options=(), variables=None):
        self.socket = pathlib.Path(folder) / f"{name}.socket"
        self.address = f"unix:{self.socket}"
        self._keys = pathlib.Path(folder) / "keys"
        if not self._keys.exists():
            self._keys.touch(mode=0o600)
            self._keys.write_text(secrets.token_hex(32) + "\n")
        self._name, self._options = name, options
        self._variables = {**os.environ, **(variables or {})}
        self.start()

    def start(self, name=None):
        self.process = subprocess.Popen(
            [BIN / (name or self._name), "--listen", self.address, "--resume-keys", self._keys, "--log-level", "off",
             *self._options], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=self._variables)
        assert self.process.stdout.readline().startswith(b"listening")

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


class Test(unittest.TestCase):
    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())

    def server(self, *args, **kwargs):
        server = Server(self.folder, *args, **kwargs)
        self.addCleanup(server.kill)
        return server

    @contextlib.contextmanager
    def fails(self, code, words=""):
        import candela_render as candela
        with self.assertRaises(candela.Error) as raised:
            yield raised
        self.assertEqual(raised.exception.code, code, raised.exception)
        self.assertIn(words, raised.exception.message)


def frames(count, height=48, width=64, dtype=numpy.float32, components=3):
    """A scene that gets brighter, in numbers that a half holds."""
    chance = numpy.random.default_rng(7)
    base = chance.random((height, width, components)).astype(numpy.float16)
    made = [(base * numpy.float16(2 ** (n / 4))).astype(numpy.float16).astype(dtype) for n in range(count)]
    if components == 4:
        for frame in made:
            frame[..., 3] = 1
    return made
