#include "server/session/session_frames.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Whether an error concerns one frame and not the whole session.
bool concerns_the_frame(const absl::Status& status) {
  return absl::IsInvalidArgument(status) || absl::IsDeadlineExceeded(status);
}

}  // namespace

SessionFrames::SessionFrames(uint32_t lookahead, double cut_threshold_ev, const ExposurePoint& point,
                             size_t capacity, bool draws, std::optional<uint64_t> resumed_at)
    : lookahead_(lookahead),
      capacity_(capacity + lookahead),
      draws_(draws),
      track_(lookahead, cut_threshold_ev, point),
      told_(point),
      resumed_at_(resumed_at) {}

bool SessionFrames::busy() const {
  // A failed frame behind one that waits is neither: its answer has to wait, too.
  return due() != nullptr || std::any_of(frames_.begin(), frames_.end(), [](const EntryPtr& entry) {
           return entry->stage == Stage::kQueued || entry->stage == Stage::kDrawing ||
                  entry->stage == Stage::kEncoding;
         });
}

absl::Status SessionFrames::add(const v1::FrameHeader& header, const WireLayout& layout,
                                const v1::Exposure& settings, std::string settings_hash, absl::Time now) {
  const std::optional<double> given = header.has_exposure() ? std::optional(header.exposure()) : std::nullopt;
  {
    absl::MutexLock lock(&track_mutex_);
    RETURN_IF_ERROR(track_.add(header.sequence(), header.media_time_ns(), header.cut(), settings, given));
  }
  auto entry = std::make_shared<Entry>();
  entry->sequence = header.sequence();
  entry->token_sequence = entry->sequence;
  entry->cut = header.cut();
  entry->layout = layout;
  if (header.timeout_ms() > 0) entry->deadline = now + absl::Milliseconds(header.timeout_ms());
  entry->settings_hash = std::move(settings_hash);
  moved_on_ |= resumed_at_ && entry->sequence > *resumed_at_;
  frames_.push_back(std::move(entry));
  return absl::OkStatus();
}

void SessionFrames::add_passed(uint64_t sequence, const WireLayout& layout, std::string settings_hash) {
  auto entry = std::make_shared<Entry>();
  entry->sequence = sequence;
  entry->token_sequence = *resumed_at_;
  entry->layout = layout;
  entry->settings_hash = std::move(settings_hash);
  entry->passed_over = true;
  entry->failure = absl::AlreadyExistsError(absl::StrFormat(
      "frame %d was answered before frame %d, whose resume token this session goes on from; it "
      "is passed over",
      sequence, *resumed_at_));
  frames_.push_back(std::move(entry));
}

void SessionFrames::passed(Entry& entry) { entry.stage = Stage::kFailed; }

void SessionFrames::close() {
  absl::MutexLock lock(&track_mutex_);
  track_.end();
}

void SessionFrames::submitted(Entry& entry, Work work, Ticket ticket) {
  CHECK(entry.stage == Stage::kReceiving || entry.stage == Stage::kWaiting);
  entry.ticket = ticket;
  entry.stage = work == Work::kDraw ? Stage::kDrawing : Stage::kQueued;
}

Exposed SessionFrames::decide(Entry& entry, const FrameStats& stats) {
  if (entry.dropped) return {};
  absl::MutexLock lock(&track_mutex_);
  track_.metered(entry.sequence, stats);
  const std::optional<FrameExposure> decided = track_.next();
  CHECK(decided && decided->sequence == entry.sequence);
  entry.exposure = decided->point;
  entry.decided = true;
  return entry.exposure.exposed;
}

void SessionFrames::metered(Entry& entry, RenderedFrame metered) {
  CHECK(entry.stage == Stage::kQueued && !entry.decided);
  entry.queued += metered.queued;
  entry.meter_stages = std::move(metered.report.stages);
  entry.stage = Stage::kWaiting;
  {
    absl::MutexLock lock(&track_mutex_);
    track_.metered(entry.sequence, metered.report.stats);
  }
  if (!draws_) entry.report = std::move(metered.report);
}

SessionFrames::EntryPtr SessionFrames::next_decided() {
  std::optional<FrameExposure> decided;
  {
    absl::MutexLock lock(&track_mutex_);
    decided = track_.next();
  }
  if (!decided) return nullptr;
  const EntryPtr entry = *std::find_if(frames_.begin(), frames_.end(), [&](const EntryPtr& candidate) {
    return candidate->stage == Stage::kWaiting && candidate->sequence == decided->sequence;
  });
  entry->exposure = decided->point;
  entry->decided = true;
  if (!draws_) finish_undrawn(*entry);
  return entry;
}

void SessionFrames::finish_undrawn(Entry& entry) {
  FrameReport& report = *entry.report;
  report.exposure = entry.exposure.exposed.exposure;
  report.target = entry.exposure.exposed.target;
  report.target_before_limits = entry.exposure.exposed.target_before_limits;
  report.stages = std::move(entry.meter_stages);
  report.plan.words = {
      absl::StrFormat("ingest %dx%d: meter", entry.layout.desc.width, entry.layout.desc.height),
      "no image: the encoding is NONE"};
  entry.stage = Stage::kDone;
}

void SessionFrames::rendered(Entry& entry, RenderedFrame rendered, bool encode) {
  CHECK(entry.submitted());
  entry.queued += rendered.queued;
  entry.report = std::move(rendered.report);
  entry.report->stages.insert(entry.report->stages.begin(), entry.meter_stages.begin(),
                              entry.meter_stages.end());
  entry.stage = encode ? Stage::kEncoding : Stage::kDone;
}

void SessionFrames::encoded(Entry& entry, std::string file, absl::Duration took) {
  CHECK(entry.stage == Stage::kEncoding && entry.report);
  entry.file = std::make_shared<const std::string>(std::move(file));
  entry.report->stages.push_back({"encode", static_cast<uint64_t>(absl::ToInt64Nanoseconds(took))});
  entry.stage = Stage::kDone;
}

bool SessionFrames::fail(Entry& entry, const absl::Status& status) {
  if (!concerns_the_frame(status) || entry.decided) return false;
  entry.failure = status;
  entry.stage = Stage::kFailed;
  absl::MutexLock lock(&track_mutex_);
  track_.failed(entry.sequence);
  return true;
}

SessionFrames::Entries SessionFrames::end_at(size_t first) {
  if (lookahead_ > 0) {
    const auto undecided = std::find_if(frames_.begin(), frames_.end(), [](const EntryPtr& entry) {
      return entry->stage == Stage::kQueued || entry->stage == Stage::kWaiting;
    });
    first = std::min(first, static_cast<size_t>(undecided - frames_.begin()));
  }
  return drop_from(first);
}

SessionFrames::Entries SessionFrames::end_before(const Entry& first) {
  const auto at = std::find_if(frames_.begin(), frames_.end(),
                               [&first](const EntryPtr& entry) { return entry.get() == &first; });
  return end_at(static_cast<size_t>(at - frames_.begin()));
}

SessionFrames::Entries SessionFrames::end_after_received() {
  const bool receiving = !frames_.empty() && newest()->stage == Stage::kReceiving;
  return end_at(frames_.size() - (receiving ? 1 : 0));
}

SessionFrames::Entries SessionFrames::drop_from(size_t first) {
  Entries dropped(frames_.begin() + static_cast<std::ptrdiff_t>(first), frames_.end());
  frames_.resize(first);
  for (const EntryPtr& entry : dropped) entry->dropped = true;
  return dropped;
}

SessionFrames::EntryPtr SessionFrames::due() const {
  if (frames_.empty()) return nullptr;
  const Stage stage = frames_.front()->stage;
  return stage == Stage::kDone || stage == Stage::kFailed ? frames_.front() : nullptr;
}

const ExposurePoint& SessionFrames::answer(const Entry& due) {
  if (due.stage != Stage::kFailed) {
    told_ = due.exposure;
  } else if (!due.passed_over && !told_.is_of(due.sequence)) {
    // The next frame begins the scene that this one was to begin. A repeated frame begins none.
    told_.cut_pending |= due.cut;
  }
  return told_;
}

void SessionFrames::pop() {
  CHECK(due() != nullptr);  // each frame has its one answer first
  ++answered_;
  frames_.pop_front();
}

}  // namespace candela
