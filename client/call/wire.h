// What a Render call and a session have in common on the client's side of the wire.
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

// 0 for a format that this client does not know.
uint64_t bytes_per_pixel(v1::PixelFormat format);

// INVALID_ARGUMENT where `bytes` is not what tight rows of such a frame come to.
absl::Status check_frame(uint32_t width, uint32_t height, v1::PixelFormat format, size_t bytes);

// How many rows of so many bytes go into one band; at least 1.
uint64_t rows_of_band(uint64_t row_bytes);

// To a server by its address. Does not connect yet: INVALID_ARGUMENT for an address of another shape, and as
// channel_credentials().
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_channel(const Peer& peer);

// The same for a session: it shares its connection with no other channel of this process, one that is lost is
// tried again soon, and one that is silent is given up as SessionOptions::ping_interval says.
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_session_channel(const Peer& peer,
                                                                    absl::Duration ping_interval);

// The one place where gRPC's errors become ours. `connected`: a message reached the server. Where none did
// and TLS may be the reason, the server is asked once more, see why_tls_fails().
absl::Status from_grpc(const grpc::Status& status, const Peer& peer, bool connected);

}  // namespace candela
