// Stands in for server/base/log.cc, which needs more libraries.
#include "server/base/log.h"

namespace candela {

LogField::LogField(absl::string_view k, double) : key(k) {}
LogField::LogField(absl::string_view k, int64_t) : key(k) {}
LogField::LogField(absl::string_view k, uint64_t) : key(k) {}

void log_event(LogLevel, absl::string_view, std::initializer_list<LogField>) {}

}  // namespace candela
