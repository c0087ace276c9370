"""Lets gRPC work in a fork of a process that has used it. Imported before grpc."""
from __future__ import annotations

import os
import sys
import time

VARIABLE = "GRPC_ENABLE_FORK_SUPPORT"  # gRPC reads it when it is imported, and again when it is first used
LONGEST_FORK = 1.0  # s
if "grpc" not in sys.modules:
    os.environ.setdefault(VARIABLE, "1")
_supported = os.environ.get(VARIABLE, "").lower() in ("1", "true", "yes")
_used = _broken = False
_switch_interval = sys.getswitchinterval()


def grpc_works() -> bool:
    """Asked before each connection is made. False where a call would wait for ever."""
    global _used
    _used = True
    return not _broken


def _before() -> None:
    """gRPC's handler in the child is Python code, which runs before Python knows that it is a fork. If another thread has asked for
    the interpreter by then, the child gives way to it and waits for ever. So none asks for a while, in which the fork is made."""
    global _switch_interval
    if _used:
        _switch_interval = sys.getswitchinterval()
        sys.setswitchinterval(LONGEST_FORK)
        time.sleep(2 * _switch_interval)  # those that wait already ask now, and get it; a busy one keeps it for LONGEST_FORK


def _after() -> None:
    if _used:
        sys.setswitchinterval(_switch_interval)


def _in_child() -> None:
    global _broken
    _broken = _used and not _supported
    _after()


os.register_at_fork(before=_before, after_in_parent=_after, after_in_child=_in_child)
