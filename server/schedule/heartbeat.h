// Whether the render thread moves and what it makes is good, found out by using it.
#pragma once

#include <functional>
#include <memory>
#include <thread>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/schedule/render_loop.h"

namespace candela {

// Counts time in ticks of its own thread, so that a process which was stopped for a while has not failed. Any
// thread.
class Heartbeat {
 public:
  struct Options {
    absl::Duration interval = absl::Seconds(5);  // after so long without a good frame it sends a beat
    absl::Duration limit = absl::Seconds(30);    // for so long the device works without a good frame
    // For so long the thread moves without an end of anything: longer, for what is slow is not stuck.
    absl::Duration moving_limit = absl::Minutes(2);
  };
  struct Pulse {
    bool working = true;  // frames come out
    bool moving = true;   // frames, or failures of them, come out
    bool operator==(const Pulse&) const = default;
  };

  // `beat` renders a small frame, called on the loop's thread before the frames that wait. `report` is called
  // on a thread of the heartbeat's own when the pulse has changed; it begins as good. Begins at once.
  Heartbeat(RenderLoop& loop, std::function<absl::Status()> beat, const Options& options,
            std::function<void(Pulse)> report);
  // As stop().
  ~Heartbeat();

  // A frame ended: `good` if it was rendered.
  void worked(bool good);

  // No beat and no report after it. Before the loop is gone; idempotent.
  void stop();

 private:
  struct State;
  void run();

  RenderLoop& loop_;
  const std::function<absl::Status()> beat_;
  const Options options_;
  const std::function<void(Pulse)> report_;
  const std::shared_ptr<State> state_;  // a beat that waits in the loop has it too
  std::thread thread_;                  // last: it uses all of the above
};

}  // namespace candela
