"""A candelad of this process's own, for calls that name no server."""
from __future__ import annotations

import atexit
import os
import secrets
import shutil
import subprocess
import tempfile
import threading

from . import _fork
from ._error import Error

# Ends the server if this process dies without a word: then the pipe that it reads ends.
_WATCH = 'read -r _; kill -9 "$1" 2>/dev/null; rm -rf "$2"'


def _program() -> str:
    named = os.environ.get("CANDELAD")
    found = shutil.which(named or "candelad")
    if found is None:
        raise Error("FAILED_PRECONDITION", f"there is no {named or 'candelad in PATH'}; install Candela, set CANDELAD to its "
                    "candelad, or name a running one, for example Session(\"unix:/run/candela.sock\")")
    return found


class _OwnServer:
    def __init__(self) -> None:
        program = _program()
        self._folder = tempfile.mkdtemp(prefix="candela-")
        self.address = f"unix:{self._folder}/socket"
        with open(f"{self._folder}/keys", "x", opener=lambda path, flags: os.open(path, flags, 0o600)) as keys:
            keys.write(secrets.token_hex(32) + "\n")  # so that sessions go on if the server has to be started again
        self._start(program)

    def _start(self, program: str) -> None:
        command = [program, "--listen", self.address, "--resume-keys", f"{self._folder}/keys", "--client-share", "100",
                   "--memory-budget", "2GiB", "--environment-budget", "1GiB", "--log-level", "error"]
        variables = {name: value for name, value in os.environ.items()
                     if not name.startswith("CANDELA_") and name != _fork.VARIABLE}
        with open(f"{self._folder}/log", "wb") as log:
            # In sessions of their own, where the terminal's Ctrl-C does not reach them.
            self._process = subprocess.Popen(command, env=variables, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                             stderr=log, start_new_session=True)
        self._watch = subprocess.Popen(["sh", "-c", _WATCH, "sh", str(self._process.pid), self._folder],
                                       stdin=subprocess.PIPE, start_new_session=True)
        assert self._process.stdout is not None
        ready = self._process.stdout.readline()
        self._process.stdout.close()
        if not ready.startswith(b"listening"):
            self._process.wait()
            with open(f"{self._folder}/log", errors="replace") as file:
                words = file.read().strip().splitlines()
            self.stop()
            raise Error("FAILED_PRECONDITION", f"{program} did not start: {words[-1] if words else 'without a word'}")

    def revive(self) -> None:
        if self._process.poll() is not None:
            self._end_watch()
            os.makedirs(self._folder, exist_ok=True)
            self._start(_program())

    def _end_watch(self) -> None:
        self._watch.kill()  # first: it must not kill what gets the number of the process
        self._watch.wait()
        assert self._watch.stdin is not None
        self._watch.stdin.close()

    def stop(self) -> None:
        self._end_watch()
        self._process.kill()  # it holds nothing that outlives its clients
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)


_lock = threading.Lock()
_own: _OwnServer | None = None


def own_server() -> str:
    """Its address. It is started for the first call, started again if it has died, and stopped when Python exits."""
    global _own
    with _lock:
        if _own is None:
            _own = _OwnServer()
        else:
            _own.revive()
        return _own.address


@atexit.register
def _stop() -> None:
    global _own
    with _lock:
        if _own is not None:
            _own.stop()
        _own = None


def _forget() -> None:
    global _own, _lock
    _own, _lock = None, threading.Lock()  # it is the parent's


os.register_at_fork(after_in_child=_forget)
