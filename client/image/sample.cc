#include "client/image/sample.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

namespace candela {

absl::StatusOr<Image> scene_image(uint32_t width, uint32_t height, const scenes::TexelFunction& texel) {
  absl::StatusOr<Image> image = make_image(width, height, ImageFormat::kRgba16f);
  if (!image.ok()) return image;
  std::byte* out = image->pixels.data();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const scenes::Texel rgba = texel(x, y);
      const half pixel[4] = {half(rgba[0]), half(rgba[1]), half(rgba[2]), half(rgba[3])};
      std::memcpy(out, pixel, sizeof pixel);
      out += sizeof pixel;
    }
  }
  return image;
}

namespace {

struct Rgb {
  float r = 0, g = 0, b = 0;
};
Rgb operator+(Rgb a, Rgb b) { return {a.r + b.r, a.g + b.g, a.b + b.b}; }
Rgb operator*(float k, Rgb a) { return {k * a.r, k * a.g, k * a.b}; }
Rgb mix(Rgb a, Rgb b, float t) { return (1 - t) * a + t * b; }

constexpr float kHorizon = 0.56f;      // from the top, in picture heights
constexpr float kHighestHill = 0.10f;  // over the horizon, in picture heights
constexpr float kStrip = 0.90f;        // where the test strip begins
constexpr float kEyeHeight = 0.25f;    // of the camera over the ground
constexpr float kSunRadiance = 1e5f;

// A lamp on a post: x in picture widths from the middle; depth and height in camera units.
struct Lamp {
  float x, depth, height;
  Rgb radiance;
};
constexpr Lamp kLamps[] = {
    {-0.16f, 1.5f, 2.0f, {420, 250, 90}}, {0.40f, 1.2f, 1.7f, {300, 260, 200}},
    {0.02f, 2.6f, 1.9f, {260, 30, 12}},   {0.17f, 2.0f, 1.8f, {20, 220, 50}},
    {0.29f, 3.4f, 1.9f, {25, 60, 380}},   {-0.08f, 4.2f, 1.9f, {230, 30, 210}},
    {0.10f, 5.5f, 1.9f, {20, 190, 220}},
};
constexpr float kLampRadius = 0.022f;  // at depth 1, in units

// The picture, in pixels. Lengths are in units of the shorter side, so that circles stay round in every
// shape.
class Scene {
 public:
  Scene(uint32_t width, uint32_t height)
      : width_(static_cast<float>(width)),
        height_(static_cast<float>(height)),
        unit_(std::min(width_, height_)) {}

  Rgb at(float x, float y) const {
    if (y > kStrip * height_) return strip(x, y);
    const float below = cover(y - kHorizon * height_);
    Rgb c = below == 0 ? sky(x, y) : below == 1 ? ground(x, y) : mix(sky(x, y), ground(x, y), below);
    if (const float inside = building_cover(x, y); inside > 0) c = mix(c, building(x, y), inside);
    for (const Lamp& lamp : kLamps) c = draw_lamp(c, lamp, x, y);
    return c;
  }

 private:
  // The share of a pixel that lies inside an edge at a distance of `inside` pixels.
  static float cover(float inside) { return std::clamp(inside + 0.5f, 0.0f, 1.0f); }

  static float length(float x, float y) { return std::sqrt(x * x + y * y); }

  static float disc_cover(float distance, float radius) {
    // Discs smaller than a pixel keep their light.
    return cover(radius - distance) * std::min(1.0f, std::numbers::pi_v<float> * radius * radius);
  }

  Rgb sky(float x, float y) const {
    const float up = std::max(0.0f, kHorizon - y / height_) / kHorizon;
    Rgb c = mix({0.85f, 0.42f, 0.20f}, {0.045f, 0.10f, 0.26f}, std::sqrt(up));
    const float distance = length(x - 0.70f * width_, y - 0.33f * height_);
    const float d = distance / unit_;
    c = c + 1.6f * std::exp(-d / 0.06f) * Rgb{1.0f, 0.72f, 0.42f} +
        0.5f * std::exp(-d / 0.25f) * Rgb{1.0f, 0.5f, 0.3f};
    c = mix(c, kSunRadiance * Rgb{1.0f, 0.88f, 0.68f}, disc_cover(distance, 0.0045f * unit_));
    if (up > kHighestHill / kHorizon) return c;
    c = mix(c, {0.16f, 0.10f, 0.13f}, cover(y - ridge(x, 0.085f, 2.3f, 0.4f)));
    return mix(c, {0.020f, 0.022f, 0.030f}, cover(y - ridge(x, 0.045f, 5.1f, 1.9f)));
  }

  // The line of a range of hills, in pixels from the top.
  float ridge(float x, float rise, float waves, float phase) const {
    const float t = 2 * std::numbers::pi_v<float> * (waves * x / width_ + phase);
    const float shape =
        0.6f + 0.25f * std::sin(t) + 0.13f * std::sin(2.7f * t + 1) + 0.06f * std::sin(7.3f * t);
    return (kHorizon - rise * shape) * height_;
  }

  Rgb ground(float x, float y) const {
    const float below = std::max((y - kHorizon * height_) / unit_, 1e-4f);
    const float depth = kEyeHeight / below;
    const float across = (x - 0.5f * width_) / unit_ * depth;
    Rgb light{0.020f, 0.018f, 0.022f};
    for (const Lamp& lamp : kLamps) {
      const float h = lamp.height * kEyeHeight;
      const float dx = across - lamp.x * width_ / unit_ * lamp.depth, dz = depth - lamp.depth;
      const float d2 = dx * dx + dz * dz + h * h;
      light = light + 0.8e-3f * h / (d2 * std::sqrt(d2)) * lamp.radiance;
    }
    // Paving, which fades out with distance as its tiles get small.
    const float tiles = std::sin(9 * across) * std::sin(9 * depth);
    const float contrast = 0.35f / (1 + 0.5f * depth * depth);
    const Rgb paving = (1 + contrast * std::clamp(8 * tiles, -1.0f, 1.0f)) * (0.35f * light);
    return mix({0.060f, 0.036f, 0.040f}, paving, std::exp(-depth / 25));  // haze
  }

  // A wall in deep shadow, bricks of about 1e-3, with four windows lit from 0.05 to 6.
  Rgb building(float x, float y) const {
    const float u = (x / width_ - 0.04f) / 0.22f, v = (y / height_ - 0.20f) / 0.46f;
    const float row = std::floor(v * 24);
    const float column = std::floor(u * 8 + 0.5f * std::fmod(row, 2.0f));
    const float tone = 0.5f + 0.5f * std::sin(12.9898f * column + 78.233f * row);
    const Rgb wall = (0.6e-3f + 0.9e-3f * tone) * Rgb{1.1f, 0.95f, 0.9f};
    for (const auto& [left, top, light] : {Window{0.14f, 0.15f, 6.0f}, Window{0.60f, 0.15f, 0.05f},
                                           Window{0.14f, 0.50f, 0.4f}, Window{0.60f, 0.50f, 2.0f}}) {
      const float inside = std::min({(u - left) * 0.22f * width_, (left + 0.26f - u) * 0.22f * width_,
                                     (v - top) * 0.46f * height_, (top + 0.20f - v) * 0.46f * height_});
      const float bar = std::fabs(u - left - 0.13f) * 0.22f * width_ - 0.004f * unit_;
      if (inside > -0.5f)
        return mix(wall, light * Rgb{1.0f, 0.62f, 0.28f}, std::min(cover(inside), cover(bar)));
    }
    return wall;
  }
  struct Window {
    float left, top, light;
  };

  float building_cover(float x, float y) const {
    return cover(
        std::min({x - 0.04f * width_, 0.26f * width_ - x, y - 0.20f * height_, 0.66f * height_ - y}));
  }

  Rgb draw_lamp(Rgb c, const Lamp& lamp, float x, float y) const {
    const float at_x = (0.5f + lamp.x) * width_;
    const float foot = kHorizon * height_ + kEyeHeight / lamp.depth * unit_;
    const float head = foot - lamp.height * kEyeHeight / lamp.depth * unit_;
    const float radius = kLampRadius / lamp.depth * unit_;
    const float post = std::min({0.15f * radius - std::fabs(x - at_x), y - head, foot - y});
    if (post > -0.5f) c = mix(c, {0.004f, 0.004f, 0.005f}, cover(post) * std::min(1.0f, 0.3f * radius));
    const float distance = length(x - at_x, y - head);
    return distance < radius + 1 ? mix(c, lamp.radiance, disc_cover(distance, radius)) : c;
  }

  // The upper half has 17 greys from 2^-10 to 2^6, one EV apart. The lower half has all hues, from 1/16 at
  // the top to 16 at the bottom.
  Rgb strip(float x, float y) const {
    const float v = (y / height_ - kStrip) / (1 - kStrip), u = x / width_;
    if (v < 0.5f) {
      const float grey = std::exp2(std::floor(u * 17) - 10);
      return {grey, grey, grey};
    }
    const auto part = [u](float shift) {
      return std::clamp(std::fabs(std::fmod(6 * u + shift, 6.0f) - 3) - 1, 0.0f, 1.0f);
    };
    return std::exp2(18 * v - 15) * Rgb{part(0), part(4), part(2)};
  }

  float width_, height_, unit_;
};

}  // namespace

absl::StatusOr<Image> sample_scene(uint32_t width, uint32_t height) {
  absl::StatusOr<Image> image = make_image(width, height, ImageFormat::kRgba32f);
  if (!image.ok()) return image;
  const Scene scene(width, height);
  std::byte* out = image->pixels.data();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x, out += 16) {
      const Rgb c = scene.at(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
      const float pixel[4] = {c.r, c.g, c.b, 1};
      std::memcpy(out, pixel, sizeof pixel);
    }
  }
  return image;
}

absl::StatusOr<Image> sample_sequence_frame(uint32_t width, uint32_t height, uint64_t index,
                                            uint64_t frames) {
  constexpr float kMost = 60000;
  absl::StatusOr<Image> image = make_image(width, height, ImageFormat::kRgba16f);
  if (!image.ok()) return image;
  const Scene scene(width, height);
  const float light = std::exp2(index < frames / 2 ? -6.0f : 6.0f);
  std::byte* out = image->pixels.data();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x, out += 8) {
      const auto from = static_cast<float>((x + index) % width);
      const Rgb c = light * scene.at(from + 0.5f, static_cast<float>(y) + 0.5f);
      const half pixel[4] = {half(std::min(c.r, kMost)), half(std::min(c.g, kMost)),
                             half(std::min(c.b, kMost)), half(1.0f)};
      std::memcpy(out, pixel, sizeof pixel);
    }
  }
  return image;
}

}  // namespace candela
