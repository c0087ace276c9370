#include "client/cli/options/report_options.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kSection[] = "Measurement";
constexpr v1::Range<double> kMegapixels{0.001, 256};

absl::Status set_megapixels(ReportOptions& options, const std::string& text) {
  std::vector<double> sizes;
  for (absl::string_view part : absl::StrSplit(text, ',')) {
    ASSIGN_OR_RETURN(const double size, parse_number("--megapixels", std::string(part), kMegapixels));
    sizes.push_back(size);
  }
  std::sort(sizes.begin(), sizes.end());
  sizes.erase(std::unique(sizes.begin(), sizes.end()), sizes.end());
  options.megapixels = std::move(sizes);
  return absl::OkStatus();
}

}  // namespace

void add_report_options(CLI::App& app, ReportOptions& options) {
  app.add_option("DIR", options.directory, "Folder to write into; created if it does not exist")
      ->required()
      ->option_text(" ");
  app.add_flag("--quick", options.quick,
               "Take at most five minutes: fewer frames, smaller images; the page says what was left out")
      ->group(kSection);
  add_text(app, kSection, "--megapixels", "LIST",
           absl::StrFormat("Frame sizes, separated by commas; each %s (default 0.25,1,2,8,33)",
                           format_range(kMegapixels)),
           [&options](const std::string& text) { return set_megapixels(options, text); });
  app.add_option("--images", options.images,
                 "Images to compare with the reference (default: the sample scene)")
      ->option_text("FILE...")
      ->group(kSection);
  app.add_option("--panoramas", options.panoramas, "Panoramas to bake (default: the sample panorama)")
      ->option_text("FILE...")
      ->group(kSection);
  add_quiet_option(app, "Output", options.quiet);
  options.server.bakes = true;
  add_server_options(app, options.server);
}

absl::Status finish_report_options(ReportOptions& options) {
  if (options.megapixels.empty()) options.megapixels = {0.25, 1, 2, 8, 33};
  absl::Status status = check_output_name(options.directory);
  status.Update(check_input_names(options.images));
  status.Update(check_input_names(options.panoramas));
  status.Update(finish_server_options(options.server));
  return status;
}

}  // namespace candela
