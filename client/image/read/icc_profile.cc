// Source: ICC.1:2022. lcms2 reads the profile, and evaluates its curves and tables.
#include "client/image/read/icc_profile.h"

#include <lcms2.h>
#include <lcms2_plugin.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <optional>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/image/color.h"
#include "client/image/power.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMostProfileBytes = 8u << 20;
constexpr uint64_t kMostProfileMemory = 32u << 20;  // of all that lcms2 ever asks for, for one profile

// lcms2 would take the memory that a damaged profile asks for. What it gives back does not count again, so
// sizes need not be remembered. A profile whose tables are all its bytes takes three times these.
void* take_counted(cmsContext context, cmsUInt32Number bytes) {
  auto& left = *static_cast<uint64_t*>(cmsGetContextUserData(context));
  if (bytes > left) return nullptr;
  left -= bytes;
  return std::malloc(bytes);
}
void* resize_counted(cmsContext context, void* old, cmsUInt32Number bytes) {
  auto& left = *static_cast<uint64_t*>(cmsGetContextUserData(context));
  if (bytes > left) return nullptr;
  left -= bytes;
  return std::realloc(old, bytes);
}
void give_back(cmsContext, void* memory) { std::free(memory); }

// A profile that is open, in a context of its own.
class OpenProfile {
 public:
  explicit OpenProfile(absl::string_view icc) {
    cmsPluginMemHandler memory{};
    memory.base = {cmsPluginMagicNumber, LCMS_VERSION, cmsPluginMemHandlerSig, nullptr};
    memory.MallocPtr = take_counted;
    memory.FreePtr = give_back;
    memory.ReallocPtr = resize_counted;
    context_ = cmsCreateContext(&memory, &left_);
    if (context_ == nullptr) return;
    profile_ = cmsOpenProfileFromMemTHR(context_, icc.data(), static_cast<cmsUInt32Number>(icc.size()));
    // Elements of floats may be so many that a pixel takes seconds. A2B0 or the curves say the same.
    for (const auto tag : {cmsSigDToB0Tag, cmsSigDToB1Tag, cmsSigDToB2Tag, cmsSigDToB3Tag}) {
      if (profile_ != nullptr) cmsWriteTag(profile_, tag, nullptr);
    }
  }
  ~OpenProfile() {
    if (transform_ != nullptr) cmsDeleteTransform(transform_);
    if (profile_ != nullptr) cmsCloseProfile(profile_);
    if (context_ != nullptr) cmsDeleteContext(context_);
  }
  OpenProfile(const OpenProfile&) = delete;
  OpenProfile& operator=(const OpenProfile&) = delete;

  cmsHPROFILE get() const { return profile_; }

  // Of a tag that lcms2 reads to this type; null if it is not there or damaged.
  template <typename Type>
  const Type* tag(cmsTagSignature name) const {
    return static_cast<const Type*>(cmsReadTag(profile_, name));
  }

  // Makes to_light() work for pixels of four codes, of which the first `components` are the profile's. False
  // if lcms2 cannot.
  bool make_table(int components) {
    const cmsCIExyY white = {kRec709.xy[6], kRec709.xy[7], 1};
    const cmsCIExyYTRIPLE primaries = {{kRec709.xy[0], kRec709.xy[1], 1},
                                       {kRec709.xy[2], kRec709.xy[3], 1},
                                       {kRec709.xy[4], kRec709.xy[5], 1}};
    cmsToneCurve* const line = cmsBuildGamma(context_, 1);
    cmsToneCurve* const lines[] = {line, line, line};
    const cmsHPROFILE light =
        line != nullptr ? cmsCreateRGBProfileTHR(context_, &white, &primaries, lines) : nullptr;
    if (line != nullptr) cmsFreeToneCurve(line);
    if (light == nullptr) return false;
    const uint32_t space = components == 1 ? PT_GRAY : components == 3 ? PT_RGB : PT_CMYK;
    const auto count = static_cast<uint32_t>(components);
    transform_ = cmsCreateTransformTHR(
        context_, profile_, COLORSPACE_SH(space) | CHANNELS_SH(count) | EXTRA_SH(4 - count) | BYTES_SH(2),
        light, TYPE_RGBA_FLT, INTENT_PERCEPTUAL, cmsFLAGS_NOCACHE);
    cmsCloseProfile(light);
    return transform_ != nullptr;
  }
  void to_light(const uint16_t* codes, size_t pixels, float* light) const {
    cmsDoTransform(transform_, codes, light, static_cast<cmsUInt32Number>(pixels));
  }

 private:
  uint64_t left_ = kMostProfileMemory;
  cmsContext context_ = nullptr;
  cmsHPROFILE profile_ = nullptr;
  cmsHTRANSFORM transform_ = nullptr;
};

// "RGB", "CMYK"; of the profile's header.
std::string space_word(cmsColorSpaceSignature space) {
  std::string word;
  for (int shift = 24; shift >= 0; shift -= 8) word.push_back(static_cast<char>(space >> shift & 255));
  return printable(absl::StripAsciiWhitespace(word));
}

absl::Status check_space(cmsHPROFILE profile, int components) {
  const cmsProfileClassSignature kind = cmsGetDeviceClass(profile);
  if (kind == cmsSigLinkClass || kind == cmsSigAbstractClass || kind == cmsSigNamedColorClass) {
    return absl::InvalidArgumentError("it is of no device");
  }
  const cmsColorSpaceSignature space = cmsGetColorSpace(profile);
  const bool fits = components == 4 ? space == cmsSigCmykData
                                    : space == cmsSigRgbData || (components == 1 && space == cmsSigGrayData);
  if (fits) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("it is of %s, and the picture of %s", space_word(space),
                                                    components == 1   ? "grey"
                                                    : components == 3 ? "RGB"
                                                                      : "CMYK"));
}

// Three curves, of R, G and B.
using Curves = std::array<const cmsToneCurve*, 3>;

double light_of_curve(const cmsToneCurve* curve, double value) {
  return cmsEvalToneCurveFloat(curve, static_cast<cmsFloat32Number>(value));
}

// Whether all three are `light` within `most`, or with `relative` within this share of it, from `first` on.
template <typename Light>
bool curves_are(const Curves& curves, const Light& light, double most, bool relative = false,
                double first = 0) {
  constexpr int kSteps = 255;
  for (const cmsToneCurve* const curve : curves) {
    for (int i = 0; i <= kSteps; ++i) {
      const double value = static_cast<double>(i) / kSteps, wanted = light(value);
      if (value < first) continue;
      if (!(std::fabs(light_of_curve(curve, value) - wanted) <= most * (relative ? wanted : 1))) return false;
    }
  }
  return true;
}

// The transfer that the curves are, or kProfile. A third of a code of 8 bits is the most that it may change.
void take_curves(const Curves& curves, const std::shared_ptr<const OpenProfile>& profile, Signal& signal) {
  constexpr double kSame = 1e-4;
  const double middle = light_of_curve(curves[0], 0.5);
  signal.gamma = middle > 0 && middle < 1 ? -log2_of(middle) : 1;
  for (const SignalTransfer transfer :
       {SignalTransfer::kLinear, SignalTransfer::kSrgb, SignalTransfer::kGamma}) {
    signal.transfer = transfer;
    if (curves_are(
            curves, [&](double v) { return light_of(signal, v); }, kSame))
      return;
  }
  // Their light is small where most of the picture is, and 1 where the signal's is the most.
  constexpr double kNear = 0.02, kDark = 0.35;
  for (const SignalTransfer transfer : {SignalTransfer::kPq, SignalTransfer::kHlg}) {
    signal.transfer = transfer;
    const double most = light_of(signal, 1);
    if (curves_are(
            curves, [&](double v) { return light_of(signal, v) / most; }, kNear, true, kDark))
      return;
  }
  signal.transfer = SignalTransfer::kProfile;
  signal.curve = [curves, profile](size_t channel, double value) {
    return light_of_curve(curves[channel], value);
  };
}

// The curves of a profile that is no more than curves and primaries.
std::optional<Curves> curves_of(const OpenProfile& profile) {
  if (cmsIsTag(profile.get(), cmsSigAToB0Tag) || cmsGetPCS(profile.get()) != cmsSigXYZData) {
    return std::nullopt;
  }
  const bool grey = cmsGetColorSpace(profile.get()) == cmsSigGrayData;
  Curves curves{};
  for (size_t i = 0; i < 3; ++i) {
    constexpr cmsTagSignature kTags[] = {cmsSigRedTRCTag, cmsSigGreenTRCTag, cmsSigBlueTRCTag};
    curves[i] = profile.tag<cmsToneCurve>(grey ? cmsSigGrayTRCTag : kTags[i]);
    // Of one that begins above 0, lcms2 moves black.
    constexpr double kBlack = 1e-4;
    if (curves[i] == nullptr || !(std::fabs(light_of_curve(curves[i], 0)) <= kBlack)) return std::nullopt;
  }
  return curves;
}

// The primaries of R, G and B by their light of D50, which the profile's connection space has, with white
// D65. Nothing if they do not add up to white: then lcms2's white has a tint.
std::optional<std::array<float, 8>> primaries_of(const OpenProfile& profile) {
  constexpr std::array<double, 2> kD65{0.3127, 0.3290};
  constexpr double kTint = 0.003;
  const cmsCIEXYZ d65{kD65[0] / kD65[1], 1, (1 - kD65[0] - kD65[1]) / kD65[1]};
  const cmsCIEXYZ& d50 = *cmsD50_XYZ();
  std::array<float, 8> xy{0, 0, 0, 0, 0, 0, static_cast<float>(kD65[0]), static_cast<float>(kD65[1])};
  cmsCIEXYZ rest = d50;
  size_t at = 0;
  for (const auto name : {cmsSigRedColorantTag, cmsSigGreenColorantTag, cmsSigBlueColorantTag}) {
    const auto* const one = profile.tag<cmsCIEXYZ>(name);
    cmsCIEXYZ adapted;
    if (one == nullptr || !cmsAdaptToIlluminant(&adapted, &d50, &d65, one)) return std::nullopt;
    const double sum = adapted.X + adapted.Y + adapted.Z;
    xy[at++] = static_cast<float>(adapted.X / sum);
    xy[at++] = static_cast<float>(adapted.Y / sum);
    rest = {rest.X - one->X, rest.Y - one->Y, rest.Z - one->Z};
  }
  if (!(std::max({std::fabs(rest.X), std::fabs(rest.Y), std::fabs(rest.Z)}) <= kTint)) return std::nullopt;
  const NamedPrimaries* const known = find_primaries(xy);
  return known != nullptr ? known->xy : xy;
}

// The code points in a profile's `cicp` tag, if they are of use: a profile's own curves say better what the
// functions of cameras (1, 6, 11, 12, 14, 15) are.
bool take_code_points(cmsHPROFILE profile, Signal& signal) {
  constexpr size_t kAt = 8;  // behind the type and four bytes of 0
  std::array<uint8_t, kAt + 4> bytes{};
  if (cmsReadRawTag(profile, cmsSigcicpTag, bytes.data(), bytes.size()) != bytes.size()) return false;
  const int primaries = bytes[kAt], transfer = bytes[kAt + 1];
  if (primaries == kUnspecifiedCode || transfer == kUnspecifiedCode || is_camera_transfer(transfer))
    return false;
  return set_code_points("", "", primaries, transfer, {}, signal).ok();
}

absl::Status read_profile(absl::string_view icc, int components, Signal& signal) {
  if (icc.size() > kMostProfileBytes) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("it has %d bytes; the limit is %d", icc.size(), kMostProfileBytes));
  }
  const auto profile = std::make_shared<OpenProfile>(icc);
  if (profile->get() == nullptr) return absl::InvalidArgumentError("it is damaged");
  RETURN_IF_ERROR(check_space(profile->get(), components));
  if (components != 4 && take_code_points(profile->get(), signal)) return absl::OkStatus();
  const bool grey = cmsGetColorSpace(profile->get()) == cmsSigGrayData;
  const std::optional<Curves> curves = components != 4 ? curves_of(*profile) : std::nullopt;
  const std::optional<std::array<float, 8>> xy = !curves ? std::nullopt
                                                 : grey  ? std::optional(kRec709.xy)
                                                         : primaries_of(*profile);
  if (xy) {
    signal.xy = *xy;
    take_curves(*curves, profile, signal);
    return absl::OkStatus();
  }
  if (!profile->make_table(grey ? 1 : components == 4 ? 4 : 3)) {
    return absl::InvalidArgumentError("its curves or tables are damaged");
  }
  signal.xy = kRec709.xy;
  signal.transfer = SignalTransfer::kProfile;
  signal.table = [profile](const uint16_t* codes, size_t pixels, float* light) {
    profile->to_light(codes, pixels, light);
  };
  return absl::OkStatus();
}

}  // namespace

void take_profile(const char* source, absl::string_view icc, int components, Signal& signal,
                  std::vector<std::string>& notes) {
  Signal found{.inks = components == 4};
  if (const absl::Status status = read_profile(icc, components, found); !status.ok()) {
    notes.push_back(absl::StrCat("its ICC profile cannot be used: ", status.message()));
    return;
  }
  signal = std::move(found);
  signal.source = source;
}

}  // namespace candela
