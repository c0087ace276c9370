#include "client/session_log.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/call/wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

SessionLog::SessionLog(v1::Settings settings, const std::optional<v1::SessionState>& state, bool raw)
    : raw_(raw), settings_(std::move(settings)) {
  if (!state) return;
  last_sequence_ = state->sequence();
  last_time_ns_ = state->media_time_ns();
}

absl::Status SessionLog::add(SessionFrame frame, absl::Time now) {
  RETURN_IF_ERROR(frame.view ? check_view(frame.width, frame.height, frame.pixels.size())
                             : check_frame(frame.width, frame.height, frame.format, frame.pixels.size()));
  if (last_sequence_ && frame.sequence <= *last_sequence_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d comes after frame %d; the sequence numbers of a session must increase",
                        frame.sequence, *last_sequence_));
  }
  if (frame.media_time_ns < last_time_ns_ || frame.media_time_ns > v1::kMediaTimeNs.max) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "frame %d has media time %d ns; it must be at least the previous frame's, %d ns, and at most %d ns",
        frame.sequence, frame.media_time_ns, last_time_ns_, v1::kMediaTimeNs.max));
  }
  // Written so that NaN fails.
  if (frame.exposure &&
      !(*frame.exposure >= v1::kExposureLimit.min && *frame.exposure <= v1::kExposureLimit.max)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d has the exposure %g; it must be between %g and %g", frame.sequence,
                        *frame.exposure, v1::kExposureLimit.min, v1::kExposureLimit.max));
  }
  last_sequence_ = frame.sequence;
  last_time_ns_ = frame.media_time_ns;
  const v1::Settings& settings = settings_of(frame.sequence);
  const v1::ImageSize image = v1::image_size(settings.output_size(), {frame.width, frame.height});
  const uint64_t bytes = image_bytes(settings, image);
  steps_.push_back({std::make_shared<const SessionFrame>(std::move(frame)), now, image, 0, {}, bytes});
  ++unanswered_;
  return absl::OkStatus();
}

absl::Status SessionLog::change(uint64_t from_sequence, const v1::Settings& settings) {
  const uint64_t least = std::max(last_sequence_ ? *last_sequence_ + 1 : 0, last_from_);
  if (from_sequence < least) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "cannot change settings from frame %d on; the first possible frame is %d", from_sequence, least));
  }
  const auto ahead = [this](const SessionStep& step) {
    return step.frame == nullptr && (!last_sequence_ || step.from_sequence > *last_sequence_);
  };
  if (std::count_if(steps_.begin(), steps_.end(), ahead) >= v1::kMaxPendingChanges) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "%d changes of settings already wait for their frames; submit frames first", v1::kMaxPendingChanges));
  }
  last_from_ = from_sequence;
  steps_.push_back({nullptr, absl::InfinitePast(), {}, from_sequence, settings, 0});
  return absl::OkStatus();
}

uint64_t SessionLog::rewind() {
  const auto sent = std::count_if(steps_.begin(), steps_.begin() + static_cast<ptrdiff_t>(given_),
                                  [](const SessionStep& step) { return step.frame != nullptr; });
  given_ = 0;
  return static_cast<uint64_t>(sent);
}

const SessionStep* SessionLog::next() { return given_ == steps_.size() ? nullptr : &steps_[given_++]; }

std::map<std::string, std::shared_ptr<const Panorama>> SessionLog::panoramas() const {
  std::map<std::string, std::shared_ptr<const Panorama>> panoramas;
  for (const SessionStep& step : steps_) {
    if (step.frame == nullptr || !step.frame->view || step.frame->panorama == nullptr) continue;
    panoramas.emplace(step.frame->view->environment(), step.frame->panorama);
  }
  return panoramas;
}

uint64_t SessionLog::image_bytes(v1::ImageSize frame) const {
  const v1::Settings& settings = settings_of(last_sequence_ ? *last_sequence_ + 1 : 0);
  return image_bytes(settings, v1::image_size(settings.output_size(), frame));
}

uint64_t SessionLog::image_bytes(const v1::Settings& settings, v1::ImageSize image) const {
  const bool hdr = settings.transfer() == v1::TRANSFER_PQ || settings.transfer() == v1::TRANSFER_HLG;
  const v1::OutputFormat format = settings.output_format() != v1::OUTPUT_FORMAT_UNSPECIFIED
                                      ? settings.output_format()
                                  : hdr ? v1::OUTPUT_FORMAT_RGBA16
                                        : v1::OUTPUT_FORMAT_RGBA8;
  return raw_ ? uint64_t{image.width} * image.height * bytes_per_pixel(format) : 0;
}

const v1::Settings& SessionLog::settings_of(uint64_t sequence) const {
  const auto changes = [sequence](const SessionStep& step) {
    return step.frame == nullptr && step.from_sequence <= sequence;
  };
  const auto last = std::find_if(steps_.rbegin(), steps_.rend(), changes);
  return last == steps_.rend() ? settings_ : last->settings;
}

std::deque<SessionStep>::const_iterator SessionLog::first_frame() const {
  return std::find_if(steps_.begin(), steps_.end(),
                      [](const SessionStep& step) { return step.frame != nullptr; });
}

const SessionStep* SessionLog::due() const {
  const auto first = first_frame();
  return first == steps_.end() || static_cast<size_t>(first - steps_.begin()) >= given_ ? nullptr : &*first;
}

void SessionLog::answered(const std::string& token) {
  const auto frame = first_frame();
  CHECK(frame != steps_.end() && unanswered_ > 0);
  CHECK(static_cast<size_t>(frame - steps_.begin()) < given_);  // no answer comes before its frame
  const uint64_t sequence = frame->frame->sequence;
  steps_.erase(frame);
  --given_;
  --unanswered_;
  if (token.empty()) return;
  token_ = token;
  // Changes are in the order of their numbers, and those for this frame come before it.
  while (!steps_.empty() && steps_.front().frame == nullptr && steps_.front().from_sequence <= sequence) {
    settings_ = std::move(steps_.front().settings);
    steps_.pop_front();
    CHECK(given_ > 0);
    --given_;
  }
}

}  // namespace candela
