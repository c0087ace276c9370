"""The exception of this package, and how a gRPC status becomes one."""
from __future__ import annotations

from typing import Any

import grpc
from google.protobuf import any_pb2, duration_pb2, empty_pb2
from google.protobuf.unknown_fields import UnknownFieldSet


class Error(Exception):
    """A call, a frame or a session failed.

    code: a word of gRPC's, for example "INVALID_ARGUMENT": the arguments are wrong, and the message names field, value and
        limit. "UNAVAILABLE": no server takes the work now. "RESOURCE_EXHAUSTED": it can never hold it.
    message: one line.
    retry_delay: seconds after which the server wants to be asked again; None if it does not say.
    reached: False if there was no connection to a server.
    """

    def __init__(self, code: str, message: str, retry_delay: float | None = None, reached: bool = True) -> None:
        super().__init__(f"{code}: {message}")
        self.code = code
        self.message = message
        self.retry_delay = retry_delay
        self.reached = reached


def invalid(message: str) -> Error:
    return Error("INVALID_ARGUMENT", message)


def protocol_error(why: str) -> Error:
    return Error("INTERNAL", f"the server does not keep to the protocol: {why}")


def _fields(message: bytes, number: int) -> list[bytes]:
    """The length-delimited values of a field. Debian does not package google.rpc's protos."""
    return [field.data for field in UnknownFieldSet(empty_pb2.Empty.FromString(message))
            if field.field_number == number and field.wire_type == 2]


def _retry_delay(call: Any) -> float | None:
    """google.rpc.Status: details = 3, each an Any. google.rpc.RetryInfo: retry_delay = 1."""
    for key, status in call.trailing_metadata() or ():
        if key != "grpc-status-details-bin":
            continue
        for detail in _fields(status, 3):
            packed = any_pb2.Any.FromString(detail)
            if packed.type_url.endswith("/google.rpc.RetryInfo"):
                for delay in _fields(packed.value, 1):
                    seconds: float = duration_pb2.Duration.FromString(delay).ToNanoseconds() * 1e-9
                    return max(0.0, seconds)
    return None


_UNREACHED = ("failed to connect", "Failed to connect", "DNS resolution failed", "backends failing", "name resolution")


def error_of(call: grpc.RpcError, address: str) -> Error:
    """`call` is what an unsuccessful call of grpc raises: a call with a status."""
    code, details = call.code().name, call.details() or ""
    if code == "UNAVAILABLE" and any(sign in details for sign in _UNREACHED):
        return Error(code, f"cannot reach a server at {address}: {details}", reached=False)
    return Error(code, details, _retry_delay(call))
