// Files that may be replaced while the process runs.
#pragma once

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "absl/synchronization/notification.h"
#include "absl/time/time.h"

namespace candela {

// Looks at files by their names, through links, and says when one of them is another one or has other
// contents.
class FileWatch {
 public:
  // `changed` is called on a thread of the watch's own: once at the beginning, so that nothing is missed
  // between a first reading and this, and whenever a look after a change found no further one.
  FileWatch(std::vector<std::string> paths, std::function<void()> changed,
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
  absl::Notification stop_;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace candela
