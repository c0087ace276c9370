// The bits of a rendered case, and the cases of which tests/bits keeps them.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "server/render/frame/frame_textures.h"
#include "server/render/host/host_executor.h"
#include "tests/support/scenes.h"

namespace candela::testing {

// FNV-1a of 64 bits.
class Hash {
 public:
  void add(std::span<const std::byte> bytes) {
    for (const std::byte b : bytes) hash_ = (hash_ ^ std::to_integer<uint64_t>(b)) * 0x100000001b3;
  }
  // Numbers, by their bits.
  template <typename T>
  requires std::is_arithmetic_v<T>
  void add(const T& number) { add(std::as_bytes(std::span(&number, 1))); }
  uint64_t value() const { return hash_; }

 private:
  uint64_t hash_ = 0xcbf29ce484222325;
};

struct Bits {
  Hash pixels;   // the image, and the same before it is quantised
  Hash numbers;  // all statistics, exposures and other facts
};

// What renders: the host's executor, in memory of the heap.
struct Bench {
  explicit Bench(uint32_t threads);
  FrameMemory take(const TextureLayout& layout, Verify verify);

  std::unique_ptr<Device> device = Device::host();
  TexturePool pool;
  HostExecutor executor;
};

struct Case {
  std::string name;  // one word a setting
  std::function<Bits(Bench&)> render;
};
std::vector<Case> frame_cases();
std::vector<Case> exposure_cases();
std::vector<Case> view_cases();

// A picture with colours outside of Rec.709, absent pixels and parts of alpha, of exact arithmetic: no
// function of the library's, which differ.
TexelFunction mixed_picture(uint32_t width, uint32_t height);
// 2^x with straight lines between the powers.
float steps_of_light(float x);

// Adds what rendering the frame gives. `exposure` is that of the frame before, and becomes its own.
void render_frame(Bench& bench, const WireFrame& frame, const v1::Settings& settings, uint64_t sequence,
                  std::optional<PreviousExposure>* previous, Bits& bits);
Bits render_frame(Bench& bench, const WireFrame& frame, const v1::Settings& settings);

}  // namespace candela::testing
