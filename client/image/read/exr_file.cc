#include "client/image/read/exr_file.h"

#include <exception>
#include <new>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/image/read/exr_header.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

constexpr size_t kMaxLibraryText = 1000;  // characters of an OpenEXR error that are passed on

}  // namespace

absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use) {
  if (absl::Status status = check_exr_header(opened); !status.ok()) return status;
  const std::string& path = opened.path();
  try {
    Imf::MultiPartInputFile file(path.c_str());
    return use(file);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: not enough memory to decode it; scale it down", path));
  } catch (const std::exception& error) {
    // Removes the file's name, which the library adds and our message has already. The text may quote the
    // file's content.
    const std::string quoted = absl::StrCat(" \"", path, "\"");
    const std::string text =
        absl::StrReplaceAll(error.what(), {{absl::string_view(quoted), ""}, {"\n", " "}});
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: damaged OpenEXR file: %s", path, printable(text, kMaxLibraryText)));
  }
}

}  // namespace candela
