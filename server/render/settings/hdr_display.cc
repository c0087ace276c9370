#include "server/render/settings/hdr_display.h"

#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/render/color/aces2.h"
#include "server/render/color/hdr_signal.h"
#include "server/render/settings/settings.h"

namespace candela {
namespace {

bool has_source_peak(const v1::Settings& settings) {
  return settings.curve() == v1::TONE_CURVE_BT2390 || settings.curve() == v1::TONE_CURVE_SHOULDER;
}

absl::Status refused(std::string words) { return absl::InvalidArgumentError(std::move(words)); }

absl::Status check_source_peak(const v1::Settings& settings) {
  if (!settings.has_source_peak_nits()) return absl::OkStatus();
  if (!has_source_peak(settings)) {
    return refused(absl::StrFormat(
        "source_peak_nits is %g and curve is %s; only bt2390 and shoulder have a source's peak",
        settings.source_peak_nits(), v1::word_of(settings.curve())));
  }
  const double peak = display_peak_nits(settings);
  if (settings.source_peak_nits() < peak) {
    return refused(absl::StrFormat(
        "source_peak_nits is %g and the display's peak %g nit; the source's must not be lower",
        settings.source_peak_nits(), peak));
  }
  return absl::OkStatus();
}

// Without PQ or HLG there is no HDR display to describe.
absl::Status check_sdr(const v1::Settings& settings) {
  const std::string transfer = v1::word_of(settings.transfer());
  const auto only_hdr = [&](const char* field, const std::string& value) {
    return refused(absl::StrFormat(
        "%s is %s, which is for HDR displays, and transfer is %s; set transfer to pq or hlg, or "
        "leave it out",
        field, value, transfer));
  };
  if (settings.has_peak_nits()) return only_hdr("peak_nits", v1::format_number(settings.peak_nits()));
  if (settings.display_primaries() != v1::PRIMARIES_UNSPECIFIED) {
    return only_hdr("display_primaries", v1::word_of(settings.display_primaries()));
  }
  if (settings.limit_primaries() != v1::PRIMARIES_UNSPECIFIED) {
    return only_hdr("limit_primaries", v1::word_of(settings.limit_primaries()));
  }
  return check_source_peak(settings);
}

absl::Status check_gain_map_settings(const v1::Settings& settings) {
  if (!settings.has_gain_map_peak_nits()) return absl::OkStatus();
  const auto refuse = [&](const std::string& what) {
    return refused(
        absl::StrFormat("gain_map_peak_nits is %g and %s; a gain map is beside an rgba8 image in srgb whose "
                        "alpha is not straight",
                        settings.gain_map_peak_nits(), what));
  };
  if (settings.transfer() != v1::TRANSFER_SRGB)
    return refuse("transfer is " + v1::word_of(settings.transfer()));
  if (settings.output_format() != v1::OUTPUT_FORMAT_RGBA8) {
    return refuse("output_format is " + v1::word_of(settings.output_format()));
  }
  if (settings.alpha() == v1::ALPHA_STRAIGHT) return refuse("alpha is straight");
  return absl::OkStatus();
}

absl::Status check_output(const v1::Settings& settings) {
  const std::string transfer = v1::word_of(settings.transfer());
  if (settings.output_format() == v1::OUTPUT_FORMAT_RGBA8) {
    return refused(absl::StrFormat(
        "output_format is rgba8 and transfer is %s, which shows bands with 8 bits; use rgba16", transfer));
  }
  if (settings.output_format() == v1::OUTPUT_FORMAT_RGBA16F) {
    return refused(absl::StrFormat(
        "output_format is rgba16f, which has no transfer, and transfer is %s; use rgba16", transfer));
  }
  const v1::Primaries primaries = settings.display_primaries();
  if (primaries != v1::PRIMARIES_REC2020 && primaries != v1::PRIMARIES_P3_D65) {
    return refused(absl::StrFormat("display_primaries is %s; HDR displays have rec2020 or p3-d65",
                                   v1::word_of(primaries)));
  }
  return absl::OkStatus();
}

absl::Status check_limit(const v1::Settings& settings) {
  const v1::Primaries limit = settings.limit_primaries();
  if (limit == v1::PRIMARIES_UNSPECIFIED) return absl::OkStatus();
  if (settings.curve() != v1::TONE_CURVE_ACES_2) {
    return refused(absl::StrFormat("limit_primaries is %s and curve is %s; only aces-2 has a limit",
                                   v1::word_of(limit), v1::word_of(settings.curve())));
  }
  if (limit == settings.display_primaries() || limit == v1::PRIMARIES_P3_D65) return absl::OkStatus();
  return refused(
      absl::StrFormat("limit_primaries is %s and display_primaries is %s; a display of rec2020 has the "
                      "limits p3-d65 and rec2020, one of p3-d65 has p3-d65",
                      v1::word_of(limit), v1::word_of(settings.display_primaries())));
}

absl::Status check_peaks(const v1::Settings& settings) {
  const double peak = settings.peak_nits();
  if (settings.curve() == v1::TONE_CURVE_ACES_2 && !aces_2_has_peak(peak)) {
    return refused(absl::StrFormat(
        "peak_nits is %g and curve is aces-2, which is published for 500, 1000, 2000 and 4000", peak));
  }
  return check_source_peak(settings);
}

}  // namespace

double display_peak_nits(const v1::Settings& settings) {
  return is_hdr(settings) ? settings.peak_nits() : kReferenceWhiteNits;
}

double curve_white(const v1::Settings& settings) {
  return has_source_peak(settings) ? settings.source_peak_nits() / kReferenceWhiteNits
                                   : settings.curve_white();
}

v1::Primaries limit_of(const v1::Settings& settings) {
  return settings.limit_primaries() == v1::PRIMARIES_UNSPECIFIED ? v1::PRIMARIES_P3_D65
                                                                 : settings.limit_primaries();
}

absl::Status check_hdr_display(const v1::Settings& settings) {
  RETURN_IF_ERROR(check_gain_map_settings(settings));
  if (!is_hdr(settings)) return check_sdr(settings);
  RETURN_IF_ERROR(check_output(settings));
  RETURN_IF_ERROR(check_limit(settings));
  switch (settings.curve()) {
    case v1::TONE_CURVE_LINEAR:
    case v1::TONE_CURVE_BT2390:
    case v1::TONE_CURVE_ACES_2:
      return check_peaks(settings);
    default:
      return refused(
          absl::StrFormat("curve is %s and transfer is %s; HDR displays have the curves linear, "
                          "bt2390 and aces-2",
                          v1::word_of(settings.curve()), v1::word_of(settings.transfer())));
  }
}

}  // namespace candela
