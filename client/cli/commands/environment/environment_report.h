// The result of `candela environment`, as text and as JSON.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "candela/v1/render.pb.h"
#include "client/run/frame_files.h"
#include "client/run/options.h"
#include "client/run/report.h"

namespace candela {

struct EnvironmentReport {
  v1::Environment panorama;  // as the server keeps it
  PrimariesUsed primaries;
  v1::BakeHeader bake;
  uint64_t missing_pixels = 0;  // of the panorama's file
  // In this order: read, start, put, the server's stages of the bake, other, write, and preview if there is
  // one. `other` is the part of the bake's call outside the server's stages.
  StageMs stage_ms;
  double total_ms = 0;
  std::vector<std::string> files;  // all that were written
  std::vector<std::string> notes;
};

// A note that counts the components that the format cannot hold; empty if there are none.
std::string losses_note(const v1::BakeHeader& bake, CubeFormat format);

// One line, with a line end.
std::string to_text(const EnvironmentReport& report, const EnvironmentOptions& options);

// One object on one line, with the keys input, output, id, panorama {width, height}, primaries {name, xy,
// from}, layout, format, handedness (null without faces), rotation_deg, roughness_mapping, size, levels
// [{size, roughness, error}], tier, had_it (the server had the panorama), bad_values {nan, inf, negative} and
// clamped_components of the panorama, missing_pixels of its file, losses {negative, clamped} of the faces in
// their format, files (all that were written, a folder for its faces), stage_ms, total_ms, notes.
std::string to_json(const EnvironmentReport& report, const EnvironmentOptions& options);

}  // namespace candela
