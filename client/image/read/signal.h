// The signal that a file holds, and its light (docs/pipeline.md section 7).
#pragma once

#include <array>
#include <cstdint>
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
};

// "PQ", "gamma 2.2"
std::string name(const Signal& signal);

// Sets transfer and primaries by their code points of ITU-T H.273. INVALID_ARGUMENT for those that cannot be
// read, with a list. `path` and `source` are named in it. 2, unspecified, leaves what `signal` has.
absl::Status set_code_points(const std::string& path, int primaries, int transfer, Signal& signal);

// Sets them by the name of an ICC profile, such as "Display P3". False if it says nothing.
bool set_by_profile_name(const std::string& profile, Signal& signal);

// The same of a file that holds the profile where `source` says, with a note if its name says nothing.
void take_profile(const std::string& source, const std::string& profile, Signal& signal,
                  std::vector<std::string>& notes);

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

  // Pixels of R, G, B and straight alpha, 0 .. 65535 each, to light that is associated with alpha.
  void decode(std::span<const uint16_t> codes, float* light) const;

  // Tells the image what it holds: primaries, and that PQ and HLG are light of a display. `bits` are those of
  // a code in the file.
  void describe(int bits, Image& image) const;

 private:
  Signal signal_;
  std::vector<float> light_;  // of each code
  bool own_values_, coded_;
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
