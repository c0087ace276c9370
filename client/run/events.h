// A run calls these while it works, so that a command can show its progress.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/run/report.h"
#include "client/session.h"

namespace candela {

// The progress of a run of many frames.
struct RunProgress {
  uint64_t done = 0;    // frames, with those that have no image
  uint64_t frames = 0;  // all; 0: not known
  absl::Duration time;  // since the first frame
  double exposure = 1;  // of the last image
};

// Every member has a default that does nothing. The run's own thread calls them, unless they say otherwise.
class RunEvents {
 public:
  virtual ~RunEvents() = default;

  // The work that begins, such as "reading in.exr".
  virtual void begins(const std::string& work) { (void)work; }
  virtual void progress(const RunProgress& progress) { (void)progress; }
  // A note for the user that should not wait for the end. Any thread.
  virtual void note(const std::string& note) { (void)note; }
  // The session lost its server and resumed.
  virtual void resumed(const SessionStats& session) { (void)session; }
  // The frame's image is where it belongs, or the frame has none. In the order of the frames. A failure ends
  // the run.
  virtual absl::Status finished(const RunFrame& frame) {
    (void)frame;
    return absl::OkStatus();
  }
};

}  // namespace candela
