#include "server/base/file_watch.h"

#include <sys/stat.h>

#include <utility>

#include "absl/strings/str_cat.h"

namespace candela {

FileWatch::FileWatch(std::vector<std::string> paths, Clock& clock, std::function<void()> changed,
                     absl::Duration interval)
    : paths_(std::move(paths)),
      changed_(std::move(changed)),
      interval_(interval),
      stop_(clock),
      thread_([this] { run(); }) {}

FileWatch::~FileWatch() {
  stop_.give();
  thread_.join();
}

// Attributes that differ when a file was replaced or changed.
std::vector<std::string> FileWatch::look() const {
  std::vector<std::string> seen;
  for (const std::string& path : paths_) {
    struct stat about {};
    if (stat(path.c_str(), &about) != 0) {
      seen.push_back("none");
      continue;
    }
    seen.push_back(absl::StrCat(about.st_dev, " ", about.st_ino, " ", about.st_mode, " ", about.st_size, " ",
                                about.st_mtim.tv_sec, " ", about.st_mtim.tv_nsec, " ", about.st_ctim.tv_sec,
                                " ", about.st_ctim.tv_nsec));
  }
  return seen;
}

void FileWatch::run() {
  std::vector<std::string> last = look();
  bool due = true;
  do {
    std::vector<std::string> now = look();
    const bool moving = now != last;
    due |= moving;
    last = std::move(now);
    if (moving || !due) continue;
    changed_();
    due = false;
  } while (!stop_.comes_within(interval_));
}

}  // namespace candela
