// The signal that a file holds, and its light (docs/pipeline.md section 7).
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

inline constexpr double kReferenceWhiteNits = 203.0;  // of light 1.0. Source: ITU-R BT.2408

struct Signal {
  SignalTransfer transfer = SignalTransfer::kSrgb;
  double gamma = 2.2;         // of kGamma: light is the signal to this power
  std::array<float, 8> xy{};  // the primaries; all 0: none are named
  std::string source = "";    // what said so: "cICP", "iCCP" ...; "" if nothing did
  double max_light_nits = 0;  // of a PQ picture's brightest pixel; 0: not known
  bool inks = false;          // the codes are C, M, Y and K; without a table, ideal ones
  // Of kProfile one of these. Both may be used as long as they live.
  // Light of a channel's value.
  std::function<double(size_t channel, double value)> curve{};
  // Light in Rec.709 of pixels of four codes: R, G, B and one more, or C, M, Y and K, 65535 being all ink.
  // The fourth of `light` stays as it is.
  std::function<void(const uint16_t* codes, size_t pixels, float* light)> table{};
};

// "PQ", "gamma 2.2"
std::string name(const Signal& signal);

// Light of a value: of 0 .. 1 of PQ and of HLG, of which it is scene light; of any of the other transfers but
// kProfile.
double light_of(const Signal& signal, double value);

inline constexpr int kUnspecifiedCode = 2;  // of primaries, transfer and matrix of ITU-T H.273

// Whether this transfer of H.273 is that of BT.709's cameras.
bool is_camera_transfer(int transfer);

// Sets transfer and primaries by their code points of ITU-T H.273. INVALID_ARGUMENT for those that mean
// nothing, if the choice does not overrule them; then `signal` stays as it is. 2, unspecified, leaves what
// `signal` has. `path` and `source` are named in the error.
absl::Status set_code_points(const std::string& path, const char* source, int primaries, int transfer,
                             const PictureChoice& choice, Signal& signal);

// Sets Adobe RGB (1998), which Exif names.
void set_adobe_rgb(Signal& signal);

// Signal::max_light_nits of a file that says how bright its pixels are, and the display that it was made on,
// in nit; 0 where it says nothing. PQ's own peak of 10000 nit says nothing, either.
double max_light(double of_pixels, double of_display);

// The light of an HLG display, whose peak is in nit. Its primaries weigh the luminance.
class HlgDisplay {
 public:
  HlgDisplay(const std::array<float, 8>& xy, double peak);

  // The factor from scene light, 0 .. 1, to the display's, of which 1.0 is reference white.
  double scale(const std::array<double, 3>& scene) const;

 private:
  std::array<double, 3> luminance_;  // of R, G and B
  double peak_, exponent_;
};

// Turns rows of codes into light. 1.0 is the display's white, or with PQ and HLG reference white, 203 nit.
class SignalDecoder {
 public:
  // `choice` overrules what the file says. Takes 10 ms.
  SignalDecoder(Signal signal, const PictureChoice& choice);

  // Pixels of R, G, B and straight alpha, 0 .. 65535 each, to light that is associated with alpha. Of inks,
  // pixels of C, M, Y and K.
  void decode(std::span<const uint16_t> codes, float* light) const;

  // Tells the image what it holds: primaries, and that PQ and HLG are light of a display. `bits` are those of
  // a code in the file.
  void describe(int bits, Image& image) const;

 private:
  void decode_rgb(std::span<const uint16_t> codes, float* light) const;

  Signal signal_;
  // Of each code, of R, G and B: each has its own, or all share one, and the step from one to the next is 0.
  std::vector<float> light_;
  size_t channel_step_ = 0;
  bool own_values_, coded_;
  bool drops_table_ = false;  // the profile's, because the choice overrules it
  double hlg_peak_;
  bool assumes_primaries_ = false;  // Rec.2020, because the file names none
  std::optional<HlgDisplay> hlg_;
};

// True if decode_values() would change the values.
bool decodes_values(const PictureChoice& choice);

// Decodes such a file's R, G and B by choice.transfer, in double. They are associated with alpha, so they are
// divided by it before and multiplied by it after; where alpha is 0 or less, they are decoded as they are.
// For PQ and HLG what is outside 0 .. 1 is cut, with a note, and a file that names no primaries has Rec.2020.
// Below 0 the straight piece of sRGB continues, and a gamma is mirrored. NaN stays NaN. `image` is kRgba32f.
void decode_values(const PictureChoice& choice, Image& image);

}  // namespace candela
