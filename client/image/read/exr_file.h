// Opens an OpenEXR file.
#pragma once

#include <OpenEXR/ImfMultiPartInputFile.h>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "client/image/read/file_reader.h"

namespace candela {

// Checks the header, opens the file and calls `use`. Returns what `use` returns. OpenEXR's exceptions become
// statuses of one line that name the file: RESOURCE_EXHAUSTED if memory ran out, else INVALID_ARGUMENT.
absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use);

}  // namespace candela
