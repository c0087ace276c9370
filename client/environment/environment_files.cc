#include "client/environment/environment_files.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <system_error>

#include "absl/strings/str_format.h"
#include "client/environment/cube_faces.h"
#include "client/image/image.h"
#include "client/image/write/atomic_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr const char* kFaceNames[kCubeFaces] = {"px", "nx", "py", "ny", "pz", "nz"};

// JSON whose numbers are floats, so that they are printed with the digits of floats.
using Json = nlohmann::basic_json<nlohmann::ordered_map, std::vector, std::string, bool, std::int64_t,
                                  std::uint64_t, float>;

absl::Status make_folder(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) return absl::OkStatus();
  std::filesystem::create_directory(path, error);
  return error ? cannot_write(path, error.value()) : absl::OkStatus();
}

absl::Status write_level(const std::string& folder, const BakedEnvironment& environment, size_t level) {
  RETURN_IF_ERROR(make_folder(folder));
  for (uint32_t face = 0; face < kCubeFaces; ++face) {
    ASSIGN_OR_RETURN(const Image picture, face_picture(environment, level, face));
    const std::string path = absl::StrFormat("%s/%s.exr", folder, kFaceNames[face]);
    if (const auto notes = write_image(path, picture); !notes.ok()) return notes.status();
  }
  return absl::OkStatus();
}

// A_l of coefficient `index`.
double lobe(size_t index) {
  constexpr double kPi = std::numbers::pi;
  return index == 0 ? kPi : index < 4 ? 2 * kPi / 3 : kPi / 4;
}

}  // namespace

absl::Status write_face_files(const std::string& folder, const BakedEnvironment& environment) {
  RETURN_IF_ERROR(check_environment(environment));
  for (size_t level = 0; level < environment.levels.size(); ++level) {
    const std::string path = level == 0 ? folder : absl::StrFormat("%s/level%d", folder, level);
    RETURN_IF_ERROR(write_level(path, environment, level));
  }
  return absl::OkStatus();
}

absl::Status write_harmonics(const std::string& path, const RadianceHarmonics& harmonics) {
  RETURN_IF_ERROR(check_harmonics(harmonics));
  Json radiance = Json::array(), irradiance = Json::array();
  for (size_t i = 0; i < harmonics.size(); ++i) {
    const auto& [r, g, b] = harmonics[i];
    const auto scaled = [i](float v) { return static_cast<float>(lobe(i) * v); };
    radiance.push_back({r, g, b});
    irradiance.push_back({scaled(r), scaled(g), scaled(b)});
  }
  const std::string text = Json{{"radiance", radiance}, {"irradiance", irradiance}}.dump(1) + "\n";
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  file.write(text.data(), text.size());
  return file.commit();
}

}  // namespace candela
