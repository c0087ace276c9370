// A client's whole session in one call, for tests that do something to its server on the way.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/session.h"
#include "tests/support/scenes.h"

namespace candela::testing {

using Film = std::shared_ptr<const std::vector<WireFrame>>;

// Frames of noise whose light goes up and down, so that each one's exposure depends on those before.
Film make_film(size_t frames, uint32_t width, uint32_t height);

// Frame `i` of it at 24 frames a second of media time, to submit.
SessionFrame frame_of(const Film& film, size_t i);

struct SessionRun {
  absl::Status status;              // how it ended
  std::vector<std::string> images;  // of frames 0, 1, ...: each of them came once, in order, and did not fail
  SessionStats stats;
};

// Streams `film` as fast as the session takes it, and takes the results.
// `on_result` is told after each how many there are.
SessionRun run_session(absl::StatusOr<Session> session, const Film& film,
                       const std::function<void(size_t)>& on_result = {});

}  // namespace candela::testing
