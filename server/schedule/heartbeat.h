// A watchdog that renders small frames to check that the render thread moves and produces good frames.
#pragma once

#include <functional>
#include <memory>
#include <thread>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/schedule/render_loop.h"

namespace candela {

// Measures time in ticks of a separate thread, so that a process that was suspended for a while does not
// count as failed. Any thread.
class Heartbeat {
 public:
  struct Options {
    // A beat is sent after this long without a good frame.
    absl::Duration interval = absl::Seconds(5);
    // The device counts as failed after this long without a good frame.
    absl::Duration limit = absl::Seconds(30);
    // The render thread counts as stuck if no frame ends for this long. It is longer than `limit`, because a
    // slow frame is not a stuck one.
    absl::Duration moving_limit = absl::Minutes(2);
  };
  struct Pulse {
    bool working = true;  // good frames are produced
    bool moving = true;   // frames end, well or with an error
    bool operator==(const Pulse&) const = default;
  };

  // Starts at once. `beat` renders a small frame; it is called on the loop's thread ahead of the waiting
  // frames. `report` is called on the heartbeat's own thread when the pulse changes from good, or later
  // changes again. `clock` outlives it.
  Heartbeat(RenderLoop& loop, Clock& clock, std::function<absl::Status()> beat, const Options& options,
            std::function<void(Pulse)> report);
  // Calls stop().
  ~Heartbeat();

  // A frame ended. `good`: it was rendered.
  void worked(bool good);

  // No beat and no report follow. Call it before the loop is destroyed. Idempotent.
  void stop();

 private:
  struct State;
  void run();

  RenderLoop& loop_;
  Clock& clock_;
  const std::function<absl::Status()> beat_;
  const Options options_;
  const std::function<void(Pulse)> report_;
  const std::shared_ptr<State> state_;  // shared with a beat that waits in the loop
  std::thread thread_;                  // last, because it uses all of the above
};

}  // namespace candela
