#include "client/color/lut_config.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

#include "client/color/view_entry.h"
#include "server/base/check.h"
#include "server/render/color/primaries.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

struct Input {
  const char* word;
  const char* builtin;  // to ACES2065-1; null for those that are made here
};

constexpr Input kInputs[] = {{"linear", nullptr},  // of Rec.709
                             {"aces2065-1", "IDENTITY"},
                             {"acescg", "ACEScg_to_ACES2065-1"},
                             {"acescc", "ACEScc_to_ACES2065-1"},
                             {"acescct", "ACEScct_to_ACES2065-1"},
                             {"logc3", "ARRI_ALEXA-LOGC-EI800-AWG_to_ACES2065-1"},
                             {"logc4", nullptr},
                             {"slog3", "SONY_SLOG3-SGAMUT3_to_ACES2065-1"},
                             {"slog3-cine", "SONY_SLOG3-SGAMUT3.CINE_to_ACES2065-1"},
                             {"vlog", "PANASONIC_VLOG-VGAMUT_to_ACES2065-1"},
                             {"log3g10", "RED_LOG3G10-RWG_to_ACES2065-1"},
                             {"clog2", "CANON_CLOG2-CGAMUT_to_ACES2065-1"},
                             {"clog3", "CANON_CLOG3-CGAMUT_to_ACES2065-1"},
                             {"log2", nullptr}};  // of linear Rec.709

// ARRI, "LogC4 Logarithmic Color Space Specification", 2022: from linear Rec.709.
void append_logc4(const ocio::GroupTransformRcPtr& group) {
  constexpr Chromaticities kWideGamut4{{0.7347, 0.2653, 0.1424, 0.8576, 0.0991, -0.0308, 0.3127, 0.3290}};
  const std::array<float, 9> to_rec709 = **matrix_to_rec709(kWideGamut4);
  std::array<double, 16> matrix{};
  for (size_t i = 0; i < 9; ++i) matrix[i / 3 * 4 + i % 3] = to_rec709[i];
  matrix[15] = 1.0;
  const ocio::MatrixTransformRcPtr gamut = ocio::MatrixTransform::Create();
  gamut->setMatrix(matrix.data());
  gamut->setDirection(ocio::TRANSFORM_DIR_INVERSE);
  group->appendTransform(gamut);

  const double a = (std::exp2(18.0) - 16.0) / 117.45, b = (1023.0 - 95.0) / 1023.0, c = 95.0 / 1023.0;
  const double t = (std::exp2(14.0 * (-c / b) + 6.0) - 64.0) / a;
  struct Same {
    explicit Same(double v) : rgb{v, v, v} {}
    double rgb[3];
  };
  const ocio::LogCameraTransformRcPtr log = ocio::LogCameraTransform::Create(Same(t).rgb);
  log->setBase(2.0);
  log->setLogSideSlopeValue(Same(b / 14.0).rgb);
  log->setLogSideOffsetValue(Same(c - 6.0 * b / 14.0).rgb);
  log->setLinSideSlopeValue(Same(a).rgb);
  log->setLinSideOffsetValue(Same(64.0).rgb);
  group->appendTransform(log);
}

// ACES2065-1 to the input of the LUT.
ocio::GroupTransformRcPtr to_input(const std::string& word) {
  const auto* const input = std::ranges::find(kInputs, word, &Input::word);
  CHECK(input != std::end(kInputs));
  const ocio::GroupTransformRcPtr group = ocio::GroupTransform::Create();
  if (input->builtin != nullptr) {
    append_builtin(group, input->builtin, ocio::TRANSFORM_DIR_INVERSE);
    return group;
  }
  append_builtin(group, "ACEScg_to_ACES2065-1", ocio::TRANSFORM_DIR_INVERSE);
  append_builtin(group, "UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", ocio::TRANSFORM_DIR_FORWARD);
  if (word == "logc4") append_logc4(group);
  if (word == "log2") {
    const ocio::LogTransformRcPtr log = ocio::LogTransform::Create();
    log->setBase(2.0);
    group->appendTransform(log);
  }
  return group;
}

// Takes low .. high to 0 .. 1.
void append_domain(const ocio::GroupTransformRcPtr& group, double low, double high) {
  const ocio::RangeTransformRcPtr range = ocio::RangeTransform::Create();
  range->setMinInValue(low);
  range->setMaxInValue(high);
  range->setMinOutValue(0.0);
  range->setMaxOutValue(1.0);
  group->appendTransform(range);
}

void add_space(const ocio::ConfigRcPtr& config, const char* name, const ocio::TransformRcPtr& from_scene) {
  const ocio::ColorSpaceRcPtr space = ocio::ColorSpace::Create();
  space->setName(name);
  if (from_scene) space->setTransform(from_scene, ocio::COLORSPACE_DIR_FROM_REFERENCE);
  config->addColorSpace(space);
}

}  // namespace

std::vector<std::string> lut_inputs() {
  std::vector<std::string> words;
  for (const Input& input : kInputs) words.emplace_back(input.word);
  return words;
}

ocio::ConstConfigRcPtr lut_config(const ViewChoice& choice) {
  const ocio::ConfigRcPtr config = ocio::Config::Create();
  config->setMajorVersion(2);
  add_space(config, "ACES2065-1", nullptr);
  config->setRole(ocio::ROLE_INTERCHANGE_SCENE, "ACES2065-1");
  const ocio::GroupTransformRcPtr shown = to_input(choice.lut_input);
  if (choice.lut_domain) append_domain(shown, choice.lut_domain->first, choice.lut_domain->second);
  const ocio::FileTransformRcPtr file = ocio::FileTransform::Create();
  file->setSrc(std::filesystem::absolute(choice.config).c_str());
  file->setInterpolation(ocio::INTERP_BEST);
  shown->appendTransform(file);
  add_space(config, "through the LUT", shown);
  const std::string name = std::filesystem::path(choice.config).filename().string();
  config->addDisplayView("LUT", name.c_str(), "through the LUT", "");
  return config;
}

}  // namespace candela
