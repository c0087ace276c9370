// Watches files that may be replaced while the process runs.
#pragma once

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/time.h"
#include "server/base/clock.h"

namespace candela {

// Checks files by name, following links, and reports when one of them was replaced or changed.
class FileWatch {
 public:
  // Calls `changed` on its own thread: once at the start, so that no change since the first reading is
  // missed, and then after each change, as soon as one check finds no further change. `clock` outlives it.
  FileWatch(std::vector<std::string> paths, Clock& clock, std::function<void()> changed,
            absl::Duration interval = absl::Seconds(1));
  ~FileWatch();
  FileWatch(const FileWatch&) = delete;
  FileWatch& operator=(const FileWatch&) = delete;

 private:
  void run();
  std::vector<std::string> look() const;

  const std::vector<std::string> paths_;
  const std::function<void()> changed_;
  const absl::Duration interval_;
  StopSign stop_;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace candela
