#include "client/cli/options/idle_options.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/base/address.h"
#include "server/base/words.h"

namespace candela {
namespace {

bool is_fixed(const Request& r) { return r.settings.exposure().mode() == v1::Exposure::MODE_MANUAL; }

bool has_bloom(const Request& r, v1::Bloom::Kind kind) {
  return r.settings.bloom().intensity() > 0 && r.settings.bloom().kind() == kind;
}

bool is_light(const Request& r) { return r.encoding != nullptr && r.encoding->holds_light() && !r.view; }

// Whole numbers up to 255, of which one is far above white.
bool has_codes_as_background(const Request& r) {
  constexpr float kLeast = 16, kMost = 255;
  const v1::Background& background = r.settings.background();
  const float rgb[] = {background.red(), background.green(), background.blue()};
  const auto is_code = [](float c) { return c <= kMost && c == std::floor(c); };
  return std::all_of(std::begin(rgb), std::end(rgb), is_code) &&
         *std::max_element(std::begin(rgb), std::end(rgb)) >= kLeast;
}

// A high percentile up to 1.
bool has_percentiles_as_fractions(const Request& r) {
  return r.given.contains("--percentiles") && r.settings.exposure().metering().percentile_high() <= 1;
}

bool is_float(const Request& r) { return r.encoding != nullptr && r.encoding->holds_light(); }

bool all_unix(const Request& r) {
  return !r.servers.empty() && std::all_of(r.servers.begin(), r.servers.end(), is_unix_address);
}

// Whether `option` is given with another value than the one that `stronger` implies.
bool contradicts(const Request& r, const char* option, const char* stronger, const char* implied) {
  const auto at = r.given.find(option);
  return at != r.given.end() && r.given.contains(stronger) && folded(at->second) != implied;
}

struct Row {
  std::vector<const char*> options;
  bool (*applies)(const Request&);  // the settings are complete
  const char* words;                // after the option's name
};

// The first row that applies to an option counts.
const Row kRows[] = {
    {{"--compensation", "--key", "--min-exposure", "--max-exposure", "--adaptation", "--speed-up",
      "--speed-down", "--elapsed", "--lookahead"},
     [](const Request& r) { return is_fixed(r) && !r.given.contains("--exposure"); },
     "changes nothing: with --ocio and --lut the exposure is 0 EV; --exposure auto meters"},
    {{"--metering", "--percentiles", "--weights", "--spot", "--ignore-below"},
     [](const Request& r) {
       return is_fixed(r) && !r.given.contains("--exposure") && !has_bloom(r, v1::Bloom::KIND_GAUSSIAN);
     },
     "changes nothing: with --ocio and --lut the exposure is 0 EV; --exposure auto meters"},
    {{"--compensation", "--key", "--min-exposure", "--max-exposure", "--adaptation", "--speed-up",
      "--speed-down", "--previous-exposure", "--elapsed", "--lookahead"},
     is_fixed,
     "changes nothing: --exposure fixes the exposure"},
    // They do decide the locked exposure that is saved.
    {{"--compensation", "--key", "--min-exposure", "--max-exposure", "--adaptation", "--speed-up",
      "--speed-down"},
     [](const Request& r) {
       return (r.given.contains("--locked-exposure") || r.given.contains("--exposures")) &&
              !r.given.contains("--save-exposures");
     },
     "changes nothing: the exposure file decides the exposure"},
    {{"--metering"},
     [](const Request& r) { return contradicts(r, "--metering", "--percentiles", "percentile"); },
     "changes nothing: --percentiles asks for percentile metering"},
    {{"--percentiles"},
     has_percentiles_as_fractions,
     "are in percent, so these meter at most the darkest hundredth; 10 % to 90 % are --percentiles 10,90"},
    {{"--background"},
     has_codes_as_background,
     "is light, where 1 is white at 0 EV, and no code of 0 .. 255; the red of code 255 is --background "
     "1,0,0"},
    {{"--weights"},
     [](const Request& r) { return contradicts(r, "--weights", "--spot", "spot"); },
     "changes nothing: --spot asks for the weights spot"},
    {{"--metering", "--percentiles", "--weights", "--spot", "--ignore-below"},
     [](const Request& r) {
       return is_fixed(r) && r.encoding != nullptr && !has_bloom(r, v1::Bloom::KIND_GAUSSIAN);
     },
     "changes nothing in the image: --exposure fixes the exposure"},
    {{"--adaptation", "--speed-up", "--speed-down"},
     [](const Request& r) { return !r.adapts; },
     "changes nothing: an image by itself takes its target; --previous-exposure gives one to adapt from"},
    {{"--adaptation", "--speed-up", "--speed-down"},
     [](const Request& r) { return r.elapsed_seconds == 0; },
     "changes nothing: no time passed since --previous-exposure; give --elapsed SECONDS"},
    {{"--bloom", "--bloom-threshold", "--bloom-softness", "--bloom-levels", "--bloom-firefly"},
     [](const Request& r) { return r.settings.bloom().intensity() == 0; },
     "changes nothing: --bloom-intensity 0 turns bloom off"},
    {{"--bloom-threshold", "--bloom-softness", "--bloom-firefly"},
     [](const Request& r) { return has_bloom(r, v1::Bloom::KIND_CONSERVE); },
     "changes nothing: --bloom conserve spreads all light"},
    {{"--bloom-softness", "--bloom-levels", "--bloom-firefly"},
     [](const Request& r) { return has_bloom(r, v1::Bloom::KIND_GAUSSIAN); },
     "changes nothing: --bloom gaussian does not use it"},
    {{"--curve-white"},
     [](const Request& r) { return r.settings.curve() != v1::TONE_CURVE_REINHARD_EXTENDED; },
     "changes nothing: only --curve reinhard-extended uses it"},
    {{"--transfer"}, [](const Request& r) { return r.view; }, "changes nothing: a view has its own encoding"},
    {{"--transfer"}, is_light, "changes nothing: .exr and .pfm files hold display-linear light"},
    {{"--dither"}, is_float, "changes nothing: .exr and .pfm files hold floats, which need none"},
    {{"--bits"},
     [](const Request& r) {
       return r.encoding == nullptr || (!r.encoding->has_16_bits() && !r.encoding->is_film());
     },
     "changes nothing: the output has no choice of bits"},
    {{"--tls", "--tls-ca", "--tls-name", "--tls-cert", "--tls-key", "--token-file"},
     [](const Request& r) { return r.servers.empty(); },
     "changes nothing: the server is built into this process; --server names another"},
    {{"--tls", "--tls-ca", "--tls-name", "--tls-cert", "--tls-key"},
     all_unix,
     "changes nothing: a connection to unix:PATH has no TLS"},
};

}  // namespace

std::vector<std::string> idle_options(Request request) {
  // A setting that is wrong beside the others is the server's to refuse.
  if (!v1::complete_settings(request.settings).ok()) return {};
  std::set<std::string> told;
  std::vector<std::string> notes;
  for (const Row& row : kRows) {
    if (!row.applies(request)) continue;
    for (const char* option : row.options) {
      if (!request.given.contains(option) || !told.insert(option).second) continue;
      notes.push_back(absl::StrFormat("%s %s", option, row.words));
    }
  }
  return notes;
}

const OutputEncoding* encoding_of(const std::string& output, v1::Encoding by_server) {
  const absl::StatusOr<const OutputEncoding*> named = output_encoding(output);
  return named.ok() ? *named : &output_encoding(by_server);
}

}  // namespace candela
