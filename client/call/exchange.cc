#include "client/call/exchange.h"

#include <algorithm>

namespace candela {

bool send_bands(RawCall& call, v1::BandKind kind, uint64_t row_bytes, std::span<const std::byte> pixels) {
  const uint64_t height = pixels.size() / row_bytes;
  const uint64_t rows = rows_of_band(row_bytes);
  for (uint64_t y = 0; y < height; y += rows) {
    const grpc::Slice band(pixels.data() + y * row_bytes, std::min(rows, height - y) * row_bytes);
    if (!call.write(v1::make_band(kind, static_cast<uint32_t>(y), band))) return false;
  }
  return true;
}

absl::Status end_of(RawCall& call, const Peer& peer) {
  const grpc::Status status = call.finish();
  return from_grpc(status, peer, call.connected());
}

}  // namespace candela
