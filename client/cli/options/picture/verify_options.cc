#include "client/cli/options/picture/verify_options.h"

#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/cli/options/words/option_kinds.h"
#include "client/image/encodings.h"

namespace candela {
namespace {

constexpr char kVerification[] = "Verification";

}  // namespace

void add_verify_options(CLI::App& app, VerifyChoice& choice) {
  app.add_flag("--verify", choice.verify,
               "Compare the image with the float64 reference and report the error; takes seconds")
      ->group(kVerification);
  add_text(app, kVerification, "--error-map", "FILE.png", "Draw the error of every pixel; implies --verify",
           [&choice](const std::string& path) {
             choice.error_map = path;
             choice.verify = true;
             return absl::OkStatus();
           });
}

absl::Status check_verify_options(const VerifyChoice& choice, const std::string& output) {
  if (choice.error_map.empty()) return absl::OkStatus();
  if (const auto encoding = output_encoding(choice.error_map);
      !encoding.ok() || (*encoding)->server != v1::ENCODING_PNG) {
    return usage_error(absl::StrFormat("--error-map is %s; it must end in .png", choice.error_map));
  }
  if (choice.error_map == output) {
    return usage_error(
        absl::StrFormat("--error-map %s: OUT is the same file; give another name", choice.error_map));
  }
  return absl::OkStatus();
}

}  // namespace candela
