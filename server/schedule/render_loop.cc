#include "server/schedule/render_loop.h"

#include <utility>

namespace candela {

RenderLoop::RenderLoop(Render render, size_t capacity, Clock& clock, absl::Duration slice)
    : RenderSteps(std::move(render), capacity, clock, slice), thread_([this] {
        while (wait()) step();
      }) {}

RenderLoop::~RenderLoop() { stop(); }

void RenderLoop::stop() {
  close();
  if (thread_.joinable()) thread_.join();
}

}  // namespace candela
