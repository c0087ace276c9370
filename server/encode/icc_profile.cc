// The ICC profiles that files get, made by lcms2. Declared in picture.h.
#include <lcms2.h>

#include <algorithm>
#include <memory>

#include "server/encode/picture.h"

namespace candela {
namespace {

struct CloseProfile {
  void operator()(void* profile) const { cmsCloseProfile(profile); }
};
using Profile = std::unique_ptr<void, CloseProfile>;

cmsToneCurve* make_curve(EncodedTransfer transfer) {
  // Y = (a X + b)^g above d, else c X.
  constexpr cmsFloat64Number kSrgb[] = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};
  constexpr cmsInt32Number kSrgbType = 4;
  if (transfer == EncodedTransfer::kSrgb) return cmsBuildParametricToneCurve(nullptr, kSrgbType, kSrgb);
  return cmsBuildGamma(nullptr, transfer == EncodedTransfer::kGamma22 ? 2.2 : 1.0);
}

const char* description(EncodedTransfer transfer) {
  return transfer == EncodedTransfer::kSrgb      ? "sRGB"
         : transfer == EncodedTransfer::kGamma22 ? "Rec.709, gamma 2.2"
                                                 : "Rec.709, linear";
}

void describe(cmsHPROFILE profile, EncodedTransfer transfer) {
  cmsMLU* words = cmsMLUalloc(nullptr, 1);
  if (words == nullptr) return;
  cmsMLUsetASCII(words, "en", "US", description(transfer));
  cmsWriteTag(profile, cmsSigProfileDescriptionTag, words);
  cmsMLUfree(words);
}

std::string make_profile(EncodedTransfer transfer) {
  const cmsCIExyY white = {0.3127, 0.3290, 1};
  const cmsCIExyYTRIPLE primaries = {{0.64, 0.33, 1}, {0.30, 0.60, 1}, {0.15, 0.06, 1}};
  cmsToneCurve* curve = make_curve(transfer);
  cmsToneCurve* curves[] = {curve, curve, curve};
  const Profile profile(curve != nullptr ? cmsCreateRGBProfile(&white, &primaries, curves) : nullptr);
  cmsFreeToneCurve(curve);
  if (profile == nullptr) return "";
  describe(profile.get(), transfer);
  cmsUInt32Number size = 0;
  if (!cmsSaveProfileToMem(profile.get(), nullptr, &size)) return "";
  std::string bytes(size, '\0');
  if (!cmsSaveProfileToMem(profile.get(), bytes.data(), &size)) return "";
  // The library dates the profile by the clock. The same picture must give the same file, so the date is
  // 1 January 2010: year, month, day, hour, minute and second as big-endian 16-bit numbers.
  constexpr size_t kDateAt = 24;
  constexpr char kDate[12] = {2010 >> 8, static_cast<char>(2010 & 255), 0, 1, 0, 1, 0, 0, 0, 0, 0, 0};
  std::copy_n(kDate, sizeof kDate, bytes.begin() + kDateAt);
  return bytes;
}

}  // namespace

const std::string& icc_profile(EncodedTransfer transfer) {
  static const std::string srgb = make_profile(EncodedTransfer::kSrgb);
  static const std::string gamma22 = make_profile(EncodedTransfer::kGamma22);
  static const std::string linear = make_profile(EncodedTransfer::kLinear);
  static const std::string none;
  return transfer == EncodedTransfer::kSrgb      ? srgb
         : transfer == EncodedTransfer::kGamma22 ? gamma22
         : transfer == EncodedTransfer::kLinear  ? linear
                                                 : none;
}

}  // namespace candela
