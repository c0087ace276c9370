// What a report comes to, in a few sentences.
#pragma once

#include <string>

#include "client/cli/report/session.h"

namespace candela {

// The head of the page: what was measured where, and which tier to take when.
std::string summary_section(const Json& report);

}  // namespace candela
