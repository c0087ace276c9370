// What a client sends in a history, and what it has to get for it.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "client/session.h"
#include "tests/support/simulated/chance.h"
#include "tests/support/simulated/undisturbed_run.h"

namespace candela {
struct Environment;
}

namespace candela::testing {

struct Film {
  SessionOptions options;
  std::vector<SessionFrame> frames;
  std::map<size_t, v1::SettingsChange> changes;  // before the frame of this index
  std::vector<v1::Settings> settings;            // that count for each frame
  std::vector<SimulatedFrame> model;             // the frames, as the model of a session wants them
  std::vector<SimulatedAnswer> answers;          // of a run that nothing disturbs, one a frame
  bool has_views = false;
};

struct FilmPlan {
  size_t most_frames = 12;   // the fewest are 1
  bool views = false;        // some frames are views of panoramas
  bool large_frames = true;  // some take two bands; the others have 3 x 3 pixels
};
Film make_film(Chance& chance, const FilmPlan& plan);

// Makes the environment the one of that panorama: its views depend on nothing else.
void identify(Environment& environment, const Panorama& panorama);

// Why the result is not that of frame `index`; OK if it is.
absl::Status check_result(const Film& film, size_t index, const FrameResult& result);

}  // namespace candela::testing
