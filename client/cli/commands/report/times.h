// The times of a report: how long frames take by size and tier, and how scenes and settings change that.
// docs/report/format.md describes the rows.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/cli/commands/report/scenes.h"
#include "client/cli/commands/report/session.h"
#include "client/panorama.h"

namespace candela {

struct TimePlan {
  std::vector<FrameSize> sizes;                  // ascending
  int frames = 11;                               // number of timed frames, after a warm-up of two
  int slow_frames = 3;                           // the same for frames that take seconds; no warm-up
  absl::Time deadline = absl::InfiniteFuture();  // work that would pass it is skipped, and its row says so
};

// `times`: every size at every tier.
Json measure_times(const ReportSession& session, const TimePlan& plan);

// `scenes`: scenes and settings at the largest planned size of at most 2 megapixels.
Json measure_scenes(const ReportSession& session, const TimePlan& plan);

// The environments of a report: the time and the error of bakes by tier, and pictures of what is baked.
// docs/report/format.md describes the rows.

struct ReportPanorama {
  std::string name;
  std::shared_ptr<const Panorama> panorama;
};

struct BakePlan {
  bool quick = false;
  absl::Time deadline = absl::InfiniteFuture();  // no bake begins after it
  std::string folder;                            // of the pictures
};

struct EnvironmentRows {
  Json environments = Json::array();
  Json bakes = Json::array();
};

// `environments` and `bakes`. Writes the pictures. Fails only if they cannot be written.
absl::StatusOr<EnvironmentRows> measure_environments(const ReportSession& session,
                                                     const std::vector<ReportPanorama>& panoramas,
                                                     const BakePlan& plan);

// The pictures of a panorama in that folder; panoramas are counted from 1.
std::string levels_name(size_t panorama);
std::string lookdev_name(size_t panorama);

}  // namespace candela
