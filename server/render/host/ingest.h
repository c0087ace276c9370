// Ingest on the host: meters the frame tile by tile, with the bits of shaders/ingest.comp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "shaders/params.h"

namespace candela::host {

// One read of a frame.
struct IngestWork {
  shader::IngestConstants constants{};
  shader::IngestParams params{};  // without addresses
  const std::byte* wire = nullptr;
  shader::TileRecord* tiles = nullptr;
  shader::HistogramBin* histogram = nullptr;   // null: none
  std::span<const uint32_t> center_weights{};  // empty: none
};

// Meters the tiles of one row of tiles: writes their records and adds to the histogram. Any thread; rows in
// any order and at the same time. Needs instruction_set().
void ingest_tiles(const IngestWork& work, uint32_t tile_row);

}  // namespace candela::host
