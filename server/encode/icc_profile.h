// The ICC profile that a JPEG carries, because JPEG itself has no word for its primaries and transfer.
#pragma once

#include <string>

#include "server/encode/picture.h"

namespace candela {

// A profile (ICC.1:2010) of Rec.709 primaries, D65 and this transfer. "" if the transfer is unknown or memory
// runs out. The same transfer gives the same bytes. Any thread; the profile is made once.
const std::string& icc_profile(EncodedTransfer transfer);

}  // namespace candela
