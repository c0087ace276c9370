#include "tests/unit/image/baked_environment_support.h"

#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "client/environment/cube_faces.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/support/files.h"

namespace candela {

Vector cube_point(uint32_t face, uint32_t i, uint32_t j, uint32_t size) {
  const double s = 2 * (i + 0.5) / size - 1, t = 2 * (j + 0.5) / size - 1;
  switch (face) {
    case 0:
      return {1, -t, -s};
    case 1:
      return {-1, -t, s};
    case 2:
      return {s, 1, t};
    case 3:
      return {s, -1, -t};
    case 4:
      return {s, -t, 1};
    default:
      return {-s, -t, -1};
  }
}

BakedEnvironment environment_of(const std::vector<uint32_t>& sizes, const WorldFunction& texel) {
  BakedEnvironment environment;
  for (size_t l = 0; l < sizes.size(); ++l) {
    BakedLevel& level = environment.levels.emplace_back();
    level.size = sizes[l];
    level.roughness = sizes.size() == 1 ? 0 : static_cast<float>(l) / static_cast<float>(sizes.size() - 1);
    level.texels = PixelBuffer(size_t{6} * level.size * level.size * 8);
    std::byte* out = level.texels.data();
    for (uint32_t face = 0; face < 6; ++face) {
      for (uint32_t j = 0; j < level.size; ++j) {
        for (uint32_t i = 0; i < level.size; ++i, out += 8) {
          const Vector value = texel(l, cube_point(face, i, j, level.size));
          uint16_t half[4] = {0, 0, 0, 0x3c00};
          for (size_t c = 0; c < 3; ++c) half[c] = imath_float_to_half(static_cast<float>(value[c]));
          std::memcpy(out, half, sizeof half);
        }
      }
    }
  }
  float next = 0;
  for (auto& rgb : environment.harmonics) {
    for (float& value : rgb) value = (next += 1) / 3;
  }
  return environment;
}

void convert_to_floats(BakedEnvironment& environment) {
  for (BakedLevel& level : environment.levels) {
    PixelBuffer floats(2 * level.texels.size());
    for (size_t i = 0; i < level.texels.size() / 2; ++i) {
      uint16_t half;
      std::memcpy(&half, level.texels.data() + 2 * i, sizeof half);
      const float value = imath_half_to_float(half);
      std::memcpy(floats.data() + 4 * i, &value, sizeof value);
    }
    level.texels = std::move(floats);
  }
  environment.format = CubeFormat::kRgba32f;
}

void convert_to_rgb9e5(BakedEnvironment& environment) {
  for (BakedLevel& level : environment.levels) {
    PixelBuffer words(level.texels.size() / 2);
    for (size_t i = 0; i < words.size() / 4; ++i) {
      const uint32_t word = v1::pack_rgb9e5(texel_rgb(level.texels.data() + 8 * i, environment.format));
      std::memcpy(words.data() + 4 * i, &word, 4);
    }
    level.texels = std::move(words);
  }
  environment.format = CubeFormat::kRgb9e5;
}

Vector telling(size_t level, const Vector& point) {
  Vector value;
  for (size_t c = 0; c < 3; ++c) value[c] = std::ldexp(2 + point[c], static_cast<int>(level));
  return value;
}

namespace {

constexpr Vector kInk = {10, 10, 10};

Vector paper_of(int wall) { return {wall < 2 ? 1.0 : 0.0, wall % 4 > 1 ? 1.0 : 0.5, wall % 2 + 0.25}; }

// The wall of the world that a face of a file shows, as faces are counted, and how its arrow lies.
struct Arrow {
  int wall;
  bool head_at_top, flag_at_right;
};
constexpr Arrow kLeft[6] = {{1, true, true},   {0, true, true}, {2, true, false},
                            {3, false, false}, {4, true, true}, {5, true, true}};
constexpr Arrow kRight[6] = {{0, true, false}, {1, true, false}, {2, true, true},
                             {3, false, true}, {4, true, false}, {5, true, false}};

}  // namespace

Vector arrows(size_t, const Vector& point) {
  const auto [x, y, z] = point;
  struct Wall {
    double distance, flag, arrow;  // along forward, the flag's side and the arrow
  };
  const Wall walls[6] = {{x, z, y}, {-x, -z, y}, {y, x, -z}, {-y, x, -z}, {z, -x, y}, {-z, x, y}};
  const auto wall = std::max_element(walls, walls + 6,
                                     [](const Wall& a, const Wall& b) { return a.distance < b.distance; });
  const double u = wall->flag, v = wall->arrow;
  const bool shaft = std::abs(u) < 0.15 && v > -0.3 && v < 0.4;
  const bool head = v >= 0.4 && v < 0.8 && std::abs(u) < 0.8 - v;
  const bool flag = u > 0 && u < 0.8 && std::abs(v) < 0.2;
  if (shaft || head || flag) return kInk;
  return paper_of(static_cast<int>(wall - walls));
}

void expect_arrows(Handedness handedness, uint32_t size,
                   const std::function<Vector(uint32_t face, uint32_t i, uint32_t j)>& texel) {
  const uint32_t low = size * 3 / 16, high = size - 1 - low, middle = size / 2;
  for (uint32_t face = 0; face < 6; ++face) {
    const Arrow& arrow = (handedness == Handedness::kLeft ? kLeft : kRight)[face];
    const Vector paper = paper_of(arrow.wall);
    EXPECT_EQ(texel(face, middle, arrow.head_at_top ? low : high), kInk) << name(handedness) << face;
    EXPECT_EQ(texel(face, middle, arrow.head_at_top ? high : low), paper) << name(handedness) << face;
    EXPECT_EQ(texel(face, arrow.flag_at_right ? high : low, middle), kInk) << name(handedness) << face;
    EXPECT_EQ(texel(face, arrow.flag_at_right ? low : high, middle), paper) << name(handedness) << face;
  }
}

namespace {

template <typename T>
T read(const std::string& bytes, size_t at) {
  T value{};
  if (at + sizeof value > bytes.size()) {
    ADD_FAILURE() << "the file ends before " << at + sizeof value;
    return value;
  }
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

void parse_keys(Ktx2& out) {
  size_t at = out.keys_at;
  const size_t end = at + out.keys_bytes;
  while (at < end) {
    const auto length = read<uint32_t>(out.file, at);
    ASSERT_LE(at + 4 + length, end);
    const std::string entry = out.file.substr(at + 4, length);
    const size_t middle = entry.find('\0');
    ASSERT_NE(middle, std::string::npos);
    ASSERT_GT(length, middle + 1);
    EXPECT_EQ(entry.back(), '\0') << "the value of " << entry.c_str() << " is not a NUL-terminated text";
    out.entries.emplace_back(entry.substr(0, middle), entry.substr(middle + 1, length - middle - 2));
    for (at += 4 + length; at % 4 != 0; ++at) EXPECT_EQ(out.file.at(at), '\0') << "padding at " << at;
  }
  EXPECT_EQ(at, end);
}

}  // namespace

Ktx2 parse_ktx2(const std::string& path) {
  Ktx2 out;
  out.file = read_file(path);
  const unsigned char identifier[] = {0xAB, 'K', 'T', 'X', ' ', '2', '0', 0xBB, 0x0D, 0x0A, 0x1A, 0x0A};
  EXPECT_EQ(out.file.substr(0, 12), std::string(reinterpret_cast<const char*>(identifier), 12));
  for (size_t k = 0; k < 9; ++k) out.header[k] = read<uint32_t>(out.file, 12 + 4 * k);
  out.descriptor_at = read<uint32_t>(out.file, 48);
  out.descriptor_bytes = read<uint32_t>(out.file, 52);
  out.keys_at = read<uint32_t>(out.file, 56);
  out.keys_bytes = read<uint32_t>(out.file, 60);
  out.global_at = read<uint64_t>(out.file, 64);
  out.global_bytes = read<uint64_t>(out.file, 72);
  for (size_t level = 0; level < out.header[7]; ++level) {
    const size_t at = 80 + 24 * level;
    out.levels.push_back(
        {read<uint64_t>(out.file, at), read<uint64_t>(out.file, at + 8), read<uint64_t>(out.file, at + 16)});
  }
  for (size_t at = 0; at < out.descriptor_bytes; at += 4) {
    out.descriptor.push_back(read<uint32_t>(out.file, out.descriptor_at + at));
  }
  parse_keys(out);
  return out;
}

std::string Ktx2::value(const std::string& key) const {
  for (const auto& [name, text] : entries) {
    if (name == key) return text;
  }
  ADD_FAILURE() << "no key " << key;
  return "";
}

Vector Ktx2::texel(size_t level, uint32_t face, uint32_t i, uint32_t j) const {
  const uint32_t size = header[2] >> level;
  const size_t index = (size_t{face} * size + j) * size + i;
  if (header[0] == 123) {
    const auto word = read<uint32_t>(file, levels[level].offset + 4 * index);
    const double scale = std::exp2(static_cast<double>(word >> 27) - 24);
    return {scale * (word & 511), scale * (word >> 9 & 511), scale * (word >> 18 & 511)};
  }
  Vector value;
  for (size_t c = 0; c < 3; ++c) {
    if (header[0] == 109) {
      value[c] = read<float>(file, levels[level].offset + 16 * index + 4 * c);
      continue;
    }
    value[c] = imath_half_to_float(read<uint16_t>(file, levels[level].offset + 8 * index + 2 * c));
  }
  return value;
}

}  // namespace candela
