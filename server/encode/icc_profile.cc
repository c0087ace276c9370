// The ICC profiles that files get, made by lcms2. Declared in picture.h.
#include <lcms2.h>

#include <algorithm>
#include <array>
#include <memory>
#include <string>

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

const char* words_of(EncodedTransfer transfer) {
  return transfer == EncodedTransfer::kSrgb      ? "sRGB"
         : transfer == EncodedTransfer::kGamma22 ? "gamma 2.2"
                                                 : "linear";
}

void describe(cmsHPROFILE profile, const std::string& description) {
  cmsMLU* words = cmsMLUalloc(nullptr, 1);
  if (words == nullptr) return;
  cmsMLUsetASCII(words, "en", "US", description.c_str());
  cmsWriteTag(profile, cmsSigProfileDescriptionTag, words);
  cmsMLUfree(words);
}

std::string make_profile(EncodedTransfer transfer, const std::array<double, 8>& xy,
                         const std::string& description) {
  const cmsCIExyY white = {xy[6], xy[7], 1};
  const cmsCIExyYTRIPLE primaries = {{xy[0], xy[1], 1}, {xy[2], xy[3], 1}, {xy[4], xy[5], 1}};
  cmsToneCurve* curve = make_curve(transfer);
  cmsToneCurve* curves[] = {curve, curve, curve};
  const Profile profile(curve != nullptr ? cmsCreateRGBProfile(&white, &primaries, curves) : nullptr);
  cmsFreeToneCurve(curve);
  if (profile == nullptr) return "";
  describe(profile.get(), description);
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
  const auto of_rec709 = [](EncodedTransfer one, const char* description) {
    return make_profile(one, {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}, description);
  };
  static const std::string srgb = of_rec709(EncodedTransfer::kSrgb, "sRGB");
  static const std::string gamma22 = of_rec709(EncodedTransfer::kGamma22, "Rec.709, gamma 2.2");
  static const std::string linear = of_rec709(EncodedTransfer::kLinear, "Rec.709, linear");
  static const std::string none;
  return transfer == EncodedTransfer::kSrgb      ? srgb
         : transfer == EncodedTransfer::kGamma22 ? gamma22
         : transfer == EncodedTransfer::kLinear  ? linear
                                                 : none;
}

std::string icc_profile(EncodedTransfer transfer, const std::array<float, 8>& xy, const std::string& name) {
  std::array<double, 8> of{};
  std::ranges::copy(xy, of.begin());
  return make_profile(transfer, of, name + ", " + words_of(transfer));
}

}  // namespace candela
