// Opens an OpenEXR file.
#pragma once

#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfThreading.h>

#include <memory>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "client/image/read/file_reader.h"

namespace candela {

// The words in the error about a file that ends before a chunk that it should have.
inline constexpr char kFileEnds[] = "the file ends too early";

// Checks the header, opens the file from its beginning and calls `use`. Returns what `use` returns. OpenEXR's
// exceptions become statuses of one line that name the file: RESOURCE_EXHAUSTED if memory ran out, else
// INVALID_ARGUMENT.
// `threads` decode chunks side by side; 0 decodes them on this thread, one at a time.
absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use,
                           int threads = Imf::globalThreadCount());

// A stream of the file for another of OpenEXR's readers, which may read while none other does.
std::unique_ptr<Imf::IStream> stream_of(FileReader& opened);

}  // namespace candela
