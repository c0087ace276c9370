// Shows a run to the user while it works, and adds its frames to the JSON.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "client/cli/json_output.h"
#include "client/cli/terminal.h"
#include "client/run/events.h"

namespace candela {

// Shows only the notes that should not wait.
class NoteDisplay : public RunEvents {
 public:
  explicit NoteDisplay(bool quiet) : quiet_(quiet) {}

  void note(const std::string& note) override;

 protected:
  const bool quiet_;
};

class RunDisplay : public NoteDisplay {
 public:
  // `quiet`: no notes. `json` and `progress` must outlive this.
  RunDisplay(bool quiet, JsonOutput& json, Progress& progress)
      : NoteDisplay(quiet), json_(json), progress_(progress) {}

  void begins(const std::string& work) override { progress_.show(work); }
  void progress(const RunProgress& progress) override;
  void resumed(const SessionStats& session) override;
  absl::Status finished(const RunFrame& frame) override;

 private:
  JsonOutput& json_;
  Progress& progress_;
};

}  // namespace candela
