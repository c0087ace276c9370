// Panoramas that a server keeps as environments, and what it bakes from them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"

namespace candela {

// A panorama to put on a server.
struct Panorama {
  v1::EnvironmentStart start;  // size, format and primaries; `total_bytes` is not used
  // Rows from top to bottom without padding. They must not change while anybody holds `owner`.
  std::span<const std::byte> pixels = {};
  // Keeps `pixels` alive. Without an owner they must live as long as the session or the call.
  std::shared_ptr<const void> owner = nullptr;
};

// INVALID_ARGUMENT unless `pixels` has the size that `start` says.
absl::Status check_panorama(const Panorama& panorama);

// The id that every server gives the panorama. Reads all pixels.
std::string environment_id(const Panorama& panorama);

// A baked cube map. Movable.
struct EnvironmentBake {
  v1::BakeHeader header;
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  // The levels of header.levels: six faces in the order +X -X +Y -Y +Z -Z, each size x size pixels, rows
  // without padding.
  std::vector<std::vector<std::byte>> levels;
};

}  // namespace candela
