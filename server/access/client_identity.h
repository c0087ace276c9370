// Identifies a client by what it cannot invent, so that one client cannot pass for many.
#pragma once

#include <grpcpp/server_context.h>
#include <sys/socket.h>

#include <string>

#include "absl/strings/string_view.h"

namespace candela {

// The client's address without its port: an IPv4 address, or "NETWORK/64", because a client chooses the other
// 64 bits of its IPv6 address. `peer` is gRPC's "ipv4:HOST:PORT", "ipv6:[HOST]:PORT" or "unix:PATH". Only the
// local processes that may open a unix: socket call through it. One of them is the proxy, so the last address
// of `forwarded_for` counts there. Without one, all of them are one client; so are those in this process.
std::string client_address(absl::string_view peer, absl::string_view forwarded_for);
// The same for the client of a call: this is the peer that the log names.
std::string client_address(const grpc::ServerContextBase& context);
// The same for the other end of a connection; "local" if it is no IP address.
std::string client_address(const sockaddr_storage& peer);
// The same for the other end of a connected socket. "unknown" if the client has reset the connection, because
// then it has no address any more.
std::string client_of(int descriptor);

// Whether the call came over a unix: socket, and from no proxy that says for whom.
bool is_straight_from_this_host(const grpc::ServerContextBase& context);

// Identifies the client of a call by its address together with its client certificate, if it has one, and
// with its bearer token if `tokens`, which says that the server checks them. None of these can be made up. It
// is at most 128 bytes long and holds no secret.
std::string client_identity(const grpc::ServerContextBase& context, bool tokens);

}  // namespace candela
