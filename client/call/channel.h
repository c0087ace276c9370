// Channels to a server and what goes wrong on them, for single calls and sessions; and what both check of a
// frame.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/security.h"

namespace candela {

// INVALID_ARGUMENT unless a frame of this size and format without padding has exactly `bytes` bytes.
absl::Status check_frame(uint32_t width, uint32_t height, v1::PixelFormat format, size_t bytes);

// INVALID_ARGUMENT unless a view of this size comes without pixels.
absl::Status check_view(uint32_t width, uint32_t height, size_t bytes);

// The number of rows of `row_bytes` bytes in a band; at least 1.
uint64_t rows_of_band(uint64_t row_bytes);

// After this long without a byte from the server, a single call pings it. If no answer comes in the same time
// again, the server is lost.
inline constexpr absl::Duration kPingInterval = absl::Seconds(10);

// A channel for single calls. It does not connect yet, and soon tries a lost connection again. Returns
// INVALID_ARGUMENT for a malformed address, and fails like channel_credentials().
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_channel(const Peer& peer);

// The same for a session, with an interval of its own (at least 1 s) in place of kPingInterval. It shares its
// connection with no other channel of this process.
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_session_channel(const Peer& peer,
                                                                    absl::Duration ping_interval);

// The error for the user, made from gRPC's. UNAVAILABLE of a server that was reached has its retry delay, see
// retry_after(). `connected` says whether the server was reached. If not, and if TLS may be the reason, this
// connects once more, see why_tls_fails().
absl::Status from_grpc(const grpc::Status& status, const Peer& peer, bool connected);

}  // namespace candela
