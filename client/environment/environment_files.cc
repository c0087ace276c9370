// Files of a baked environment: the faces, the harmonics, and KTX2. Sources of KTX2: the KTX File Format
// Specification 2.0 and the Khronos Data Format Specification 1.3, both at https://registry.khronos.org.
#include "client/environment/environment_files.h"

#include <bit>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/environment/cube_faces.h"
#include "client/image/image.h"
#include "client/image/write/atomic_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr uint32_t kHeaderBytes = 80, kLevelIndexBytes = 24;

// Numbers as little-endian bytes.
void append_u32(std::string& bytes, uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>(value >> shift & 0xff));
}

void append_u64(std::string& bytes, uint64_t value) {
  append_u32(bytes, static_cast<uint32_t>(value));
  append_u32(bytes, static_cast<uint32_t>(value >> 32));
}

uint64_t aligned(uint64_t at, uint64_t alignment) { return (at + alignment - 1) / alignment * alignment; }

// One sample of a descriptor: some bits of a texel.
struct Sample {
  uint32_t bit_offset, bits, channel;  // `channel` with its qualifiers
  uint32_t lower, upper;               // the sample values of 0, or -1 if signed, and 1
};

constexpr uint32_t kExponent = 0x20, kSigned = 0x40, kFloat = 0x80;

std::vector<Sample> samples_of(CubeFormat format) {
  std::vector<Sample> samples;
  if (format != CubeFormat::kRgb9e5) {
    const uint32_t bits = format == CubeFormat::kRgba32f ? 32 : 16;
    const uint32_t channels[] = {0, 1, 2, 15};  // R, G, B, alpha
    for (uint32_t c = 0; c < 4; ++c) {
      samples.push_back({bits * c, bits, channels[c] | kSigned | kFloat, std::bit_cast<uint32_t>(-1.0f),
                         std::bit_cast<uint32_t>(1.0f)});
    }
    return samples;
  }
  // A mantissa and the shared exponent of each channel. A mantissa of 256 with exponent 16 is 1; 8448 is
  // 256 + (16 << 9), as the Data Format Specification's example has it. The exponent's bias is its lower.
  for (uint32_t c = 0; c < 3; ++c) {
    samples.push_back({9 * c, 9, c, 0, 8448});
    samples.push_back({27, 5, c | kExponent, 15, 31});
  }
  return samples;
}

// The format as Vulkan numbers it, and the size of what it is made of.
struct VulkanFormat {
  uint32_t number, type_bytes;
};
VulkanFormat vulkan_format(CubeFormat format) {
  if (format == CubeFormat::kRgba32f) return {109, 4};
  if (format == CubeFormat::kRgba16f) return {97, 2};
  return {123, 4};
}

// The data format descriptor: one basic block.
std::string descriptor(CubeFormat format) {
  constexpr uint32_t kVersion = 2, kModelRgbsda = 1, kPrimariesBt709 = 1, kTransferLinear = 1;
  const std::vector<Sample> samples = samples_of(format);
  const auto block_bytes = static_cast<uint32_t>(24 + 16 * samples.size());
  std::string bytes;
  append_u32(bytes, 4 + block_bytes);
  append_u32(bytes, 0);  // Khronos; basic format
  append_u32(bytes, kVersion | block_bytes << 16);
  append_u32(bytes, kModelRgbsda | kPrimariesBt709 << 8 | kTransferLinear << 16);  // straight alpha
  append_u32(bytes, 0);                                                            // blocks of 1x1x1x1 texels
  append_u32(bytes, bytes_per_texel(format));                                      // in plane 0
  append_u32(bytes, 0);
  for (const Sample& sample : samples) {
    append_u32(bytes, sample.bit_offset | (sample.bits - 1) << 16 | sample.channel << 24);
    append_u32(bytes, 0);  // at the texel's origin
    append_u32(bytes, sample.lower);
    append_u32(bytes, sample.upper);
  }
  return bytes;
}

std::string number(float value) { return absl::StrFormat("%.9g", value); }

std::string key_values(const BakedEnvironment& environment) {
  std::vector<std::string> roughness, harmonics;
  for (const BakedLevel& level : environment.levels) roughness.push_back(number(level.roughness));
  for (const auto& rgb : environment.harmonics) {
    for (const float value : rgb) harmonics.push_back(number(value));
  }
  const std::pair<const char*, std::string> sorted[] = {
      {"KTXorientation", "rd"},
      {"KTXwriter", "candela " CANDELA_VERSION},
      {"candela.handedness", name(environment.handedness)},
      {"candela.roughness", absl::StrJoin(roughness, " ")},
      {"candela.sh", absl::StrJoin(harmonics, " ")},
  };
  std::string bytes;
  for (const auto& [key, value] : sorted) {
    const std::string entry = absl::StrCat(key, std::string(1, '\0'), value, std::string(1, '\0'));
    append_u32(bytes, static_cast<uint32_t>(entry.size()));
    bytes += entry;
    bytes.resize(aligned(bytes.size(), 4));
  }
  return bytes;
}

// Everything before the first level's data, which is the smallest level's.
std::string head(const BakedEnvironment& environment) {
  const auto [number, type_bytes] = vulkan_format(environment.format);
  const auto levels = static_cast<uint32_t>(environment.levels.size());
  const std::string format = descriptor(environment.format), keys = key_values(environment);
  const auto format_at = kHeaderBytes + levels * kLevelIndexBytes;
  const auto keys_at = static_cast<uint32_t>(format_at + format.size());
  const uint64_t data_at = aligned(keys_at + keys.size(), bytes_per_texel(environment.format));

  std::string bytes("\xABKTX 20\xBB\r\n\x1A\n", 12);
  const uint32_t size = environment.levels[0].size;
  // vkFormat, typeSize, pixelWidth, pixelHeight, pixelDepth, layerCount, faceCount, levelCount,
  // supercompressionScheme
  for (const uint32_t value : {number, type_bytes, size, size, 0u, 0u, kCubeFaces, levels, 0u}) {
    append_u32(bytes, value);
  }
  for (const uint32_t value :
       {format_at, static_cast<uint32_t>(format.size()), keys_at, static_cast<uint32_t>(keys.size())}) {
    append_u32(bytes, value);
  }
  append_u64(bytes, 0);  // no data of a supercompression
  append_u64(bytes, 0);
  uint64_t end = data_at;
  for (const BakedLevel& level : environment.levels) end += level.texels.size();
  for (const BakedLevel& level : environment.levels) {
    end -= level.texels.size();
    append_u64(bytes, end);
    append_u64(bytes, level.texels.size());
    append_u64(bytes, level.texels.size());
  }
  bytes += format + keys;
  bytes.resize(data_at);
  return bytes;
}

void write_ktx2_level(AtomicFile& file, const BakedEnvironment& environment, size_t level) {
  const uint32_t size = environment.levels[level].size;
  std::vector<std::byte> row(size_t{size} * bytes_per_texel(environment.format));
  for (uint32_t face = 0; face < kCubeFaces; ++face) {
    const FileFace from = file_face(face, environment.handedness);
    for (uint32_t j = 0; j < size; ++j) {
      copy_row(environment, level, from, j, row.data());
      if (!file.write(row.data(), row.size())) return;  // commit() has the reason
    }
  }
}

}  // namespace

absl::Status write_ktx2(const std::string& path, const BakedEnvironment& environment) {
  RETURN_IF_ERROR(check_environment(environment));
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  const std::string start = head(environment);
  file.write(start.data(), start.size());
  for (size_t level = environment.levels.size(); level-- > 0;) write_ktx2_level(file, environment, level);
  return file.commit();
}

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

absl::Status write_faces_of_level(const std::string& folder, const BakedEnvironment& environment,
                                  size_t level) {
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
    RETURN_IF_ERROR(write_faces_of_level(path, environment, level));
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
