"""Connections to servers: addresses, TLS and tokens."""
from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import grpc

from . import _fork
from ._error import Error, invalid
from ._server import own_server

Servers = str | os.PathLike[str] | list[str] | tuple[str, ...] | None  # None: this process's own


@dataclass(frozen=True, kw_only=True)
class Security:
    """TLS and a token, for all servers. A "unix:PATH" address never uses TLS, but sends the token."""

    tls: bool = False
    """Use TLS. ca_file, cert_file and server_name imply it."""
    ca_file: str = ""
    """PEM file of CAs to trust. Empty: gRPC's own."""
    cert_file: str = ""
    """PEM file with a client certificate, for servers that ask for one. Needs key_file."""
    key_file: str = ""
    """PEM file with the private key of cert_file."""
    server_name: str = ""
    """The name in the server's certificate, if it is not the address's host."""
    token_file: str = ""
    """A file whose first line that is neither empty nor begins with # is a bearer token. It is read for each call.
    A token is never sent over plain TCP except to loopback."""


def _is_unix(address: str) -> bool:
    return address.startswith("unix:")


def _is_loopback(address: str) -> bool:
    host = address.rpartition(":")[0].strip("[]")
    return host in ("localhost", "::1") or host.startswith("127.")


def _read(what: str, path: str) -> bytes | None:
    if not path:
        return None
    try:
        with open(path, "rb") as file:
            return file.read(1 << 20)
    except OSError as error:
        raise invalid(f"cannot read the {what} {path}: {error.strerror}") from None


def _token(path: str) -> str:
    for line in (_read("token file", path) or b"").decode("ascii", "replace").splitlines():
        token = line.strip()
        if token and not token.startswith("#"):
            if not (token.isascii() and token.isprintable() and " " not in token):
                raise invalid(f"the token in {path} holds a character that is not visible ASCII")
            return token
    raise invalid(f"the token file {path} holds no token")


def _credentials(security: Security) -> grpc.ChannelCredentials:
    if bool(security.cert_file) != bool(security.key_file):
        raise invalid("a client certificate needs its key: give both cert_file and key_file")
    return grpc.ssl_channel_credentials(_read("CA file", security.ca_file), _read("client key", security.key_file),
                                        _read("client certificate", security.cert_file))


class Connection:
    """A channel to one server. It connects by itself when it is used. Any thread may use it."""

    def __init__(self, address: str, security: Security, ping_interval: float = 10, own: bool = False) -> None:
        if not _fork.grpc_works():
            raise Error("FAILED_PRECONDITION", "this process is a fork of one that used gRPC, which was imported without "
                        f"{_fork.VARIABLE}=1: import candela_render before grpc, or set the variable before Python starts")
        self.address = address
        self._own = own
        self._token_file = security.token_file
        local = _is_unix(address)
        if not local and not address.rpartition(":")[2].isdigit():
            raise invalid(f'the server is "{address}"; give HOST:PORT or unix:PATH')
        wants_tls = security.tls or bool(security.ca_file or security.cert_file or security.server_name)
        ping_ms = max(1000, int(ping_interval * 1000))
        options: list[tuple[str, Any]] = [
            ("grpc.enable_http_proxy", 0), ("grpc.use_local_subchannel_pool", 1), ("grpc.max_receive_message_length", 4 << 20),
            ("grpc.initial_reconnect_backoff_ms", 100), ("grpc.max_reconnect_backoff_ms", 1000),
            # gRPC looks the address up again before it connects again, by default every 30 s at most.
            ("grpc.dns_min_time_between_resolutions_ms", 100),
            ("grpc.keepalive_time_ms", ping_ms), ("grpc.keepalive_timeout_ms", ping_ms),
            ("grpc.http2.max_pings_without_data", 0)]
        if wants_tls and not local:
            if security.server_name:
                options.append(("grpc.ssl_target_name_override", security.server_name))
            self.channel = grpc.secure_channel(address, _credentials(security), options)
        elif security.token_file and not local and not _is_loopback(address):
            raise invalid(f"a token is not sent to {address} in the clear, where anyone on the way could read it; use TLS, "
                          "or leave the token out")
        else:
            if local:  # gRPC would escape the path's special characters in "authority"
                options.append(("grpc.default_authority", "localhost"))
            self.channel = grpc.insecure_channel(address, options)
        self.begin()  # a token file that cannot be read is an error now

    def begin(self) -> list[tuple[str, str]]:
        """Before each call: the metadata that goes with it."""
        if self._own:
            own_server()
        return [("authorization", f"Bearer {_token(self._token_file)}")] if self._token_file else []

    def close(self) -> None:
        self.channel.close()


def connect(server: Servers, security: Security, ping_interval: float = 10) -> list[Connection]:
    """To one address, several, or several in one text with commas between them."""
    if server is None:
        return [Connection(own_server(), security, ping_interval, own=True)]
    listed = [str(server)] if isinstance(server, (str, os.PathLike)) else [str(one) for one in server]
    found = [address.strip() for one in listed for address in one.split(",") if address.strip()]
    if not found:
        raise invalid("there is no address of a server; give HOST:PORT or unix:PATH")
    return [Connection(address, security, ping_interval) for address in found]
