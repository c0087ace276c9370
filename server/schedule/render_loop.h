// The render thread.
#pragma once

#include <cstddef>
#include <thread>

#include "server/schedule/render_steps.h"

namespace candela {

// Steps with a thread that calls them. Any thread may call it. A `done` callback must not call stop().
class RenderLoop final : public RenderSteps {
 public:
  RenderLoop(Render render, size_t capacity, Clock& clock, absl::Duration slice = kSlice);
  // Calls stop().
  ~RenderLoop();

  // Accepts no more jobs, finishes those that it has, and returns when the thread has ended. Idempotent.
  void stop();

 private:
  std::thread thread_;
};

}  // namespace candela
