#include "proto/candela/v1/environment_id.h"

#include <openssl/evp.h>

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace candela::v1 {
namespace {

constexpr size_t kIdDigits = 64;

// Absent primaries are Rec.709, and an absent treatment of bad values is the scrub.
std::string meaning_of(const EnvironmentStart& start) {
  std::string primaries = absl::StrCat(
      start.input_primaries() == PRIMARIES_UNSPECIFIED ? PRIMARIES_REC709 : start.input_primaries());
  if (start.has_input_chromaticities()) {
    const Chromaticities& c = start.input_chromaticities();
    primaries = absl::StrFormat("%.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g", c.red_x(), c.red_y(), c.green_x(),
                                c.green_y(), c.blue_x(), c.blue_y(), c.white_x(), c.white_y());
  }
  const int bad_values =
      start.bad_values() == BAD_VALUES_UNSPECIFIED ? static_cast<int>(BAD_VALUES_SCRUB) : start.bad_values();
  return absl::StrFormat("candela environment 1; %dx%d; format %d; primaries %s; bad values %d\n",
                         start.width(), start.height(), static_cast<int>(start.format()), primaries,
                         bad_values);
}

}  // namespace

struct EnvironmentId::Digest {
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context{EVP_MD_CTX_new(), EVP_MD_CTX_free};
};

EnvironmentId::EnvironmentId(const EnvironmentStart& start) : digest_(std::make_unique<Digest>()) {
  EVP_DigestInit_ex(digest_->context.get(), EVP_sha256(), nullptr);
  const std::string meaning = meaning_of(start);
  EVP_DigestUpdate(digest_->context.get(), meaning.data(), meaning.size());
}

EnvironmentId::EnvironmentId(EnvironmentId&&) noexcept = default;
EnvironmentId& EnvironmentId::operator=(EnvironmentId&&) noexcept = default;
EnvironmentId::~EnvironmentId() = default;

void EnvironmentId::add(std::span<const std::byte> pixels) {
  EVP_DigestUpdate(digest_->context.get(), pixels.data(), pixels.size());
}

std::string EnvironmentId::finish() {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_DigestFinal_ex(digest_->context.get(), digest, &size);
  return absl::BytesToHexString({reinterpret_cast<const char*>(digest), size});
}

bool is_environment_id(absl::string_view id) {
  return id.size() == kIdDigits && std::all_of(id.begin(), id.end(), [](char c) {
           return absl::ascii_isdigit(static_cast<unsigned char>(c)) || (c >= 'a' && c <= 'f');
         });
}

}  // namespace candela::v1
