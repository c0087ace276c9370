#include "tests/service/sessions/session_run.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <thread>

#include "tests/service/service_fixture.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/status.h"

namespace candela::testing {

Film make_film(size_t frames, uint32_t width, uint32_t height) {
  auto film = std::make_shared<std::vector<WireFrame>>();
  for (size_t i = 0; i < frames; ++i) {
    const auto number = static_cast<uint32_t>(i);
    const float light = std::exp2(4 * std::sin(0.7f * static_cast<float>(i)));
    film->push_back(make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
      return {light * noise(x, y, 3 * number), light * noise(x, y, 3 * number + 1),
              light * noise(x, y, 3 * number + 2), 1};
    }));
  }
  return film;
}

SessionFrame frame_of(const Film& film, size_t i) {
  const WireFrame& frame = film->at(i);
  return {.width = frame.desc.width,
          .height = frame.desc.height,
          .format = wire_format(frame.desc.format),
          .pixels = frame.pixels,
          .owner = film,
          .sequence = i,
          .media_time_ns = film_time_ns(i)};
}

SessionRun run_frames(absl::StatusOr<Session> session, size_t first, size_t last,
                      const std::function<SessionFrame(size_t)>& frame,
                      const std::function<void(size_t)>& on_result) {
  SessionRun run;
  run.status = session.status();
  if (!session.ok()) return run;
  std::thread feeder([&] {
    for (size_t i = first; i < last; ++i) {
      if (!session->submit(frame(i)).ok()) return;
    }
    session->finish();
  });
  while (true) {
    const absl::StatusOr<std::optional<FrameResult>> result = session->next_result();
    run.status = result.status();
    if (!result.ok() || !*result) break;
    const FrameResult& shown = **result;
    EXPECT_EQ(shown.sequence, first + run.images.size());
    EXPECT_OK(shown.status);
    run.images.emplace_back(reinterpret_cast<const char*>(shown.image.data.get()), shown.image.bytes);
    run.headers.push_back(shown.image.header);
    if (on_result) on_result(run.images.size());
  }
  feeder.join();
  run.stats = session->stats();
  return run;
}

SessionRun run_session(absl::StatusOr<Session> session, const Film& film,
                       const std::function<void(size_t)>& on_result) {
  const auto frame = [&film](size_t i) { return frame_of(film, i); };
  return run_frames(std::move(session), 0, film->size(), frame, on_result);
}

}  // namespace candela::testing
