// Runs a client's whole session in one call, for tests that disturb its server meanwhile.
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

// Noise with varying brightness, so that each frame's exposure depends on the frames before it.
Film make_film(size_t frames, uint32_t width, uint32_t height);

// Frame `i`, ready to submit, at 24 frames a second of media time.
SessionFrame frame_of(const Film& film, size_t i);

struct SessionRun {
  absl::Status status;              // the session's
  std::vector<std::string> images;  // of the frames in their order; each came once and did not fail
  std::vector<v1::ResultHeader> headers;
  SessionStats stats;

  std::vector<double> exposures() const {
    std::vector<double> all;
    for (const v1::ResultHeader& header : headers) all.push_back(header.exposure());
    return all;
  }
};

// Streams the frames `first` .. `last` - 1 as fast as the session accepts them, and takes the results. Calls
// `on_result` after each result with the number of results so far.
SessionRun run_frames(absl::StatusOr<Session> session, size_t first, size_t last,
                      const std::function<SessionFrame(size_t)>& frame,
                      const std::function<void(size_t)>& on_result = {});

// The same for all frames of a film.
SessionRun run_session(absl::StatusOr<Session> session, const Film& film,
                       const std::function<void(size_t)>& on_result = {});

}  // namespace candela::testing
