#include "server/session/client_memory.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"

namespace candela {

ClientPresence::Visit::Visit(ClientPresence& presence, ClientId client)
    : presence_(presence), client_(client) {
  absl::MutexLock lock(&presence_.mutex_);
  ++presence_.calls_[client_];
}

ClientPresence::Visit::~Visit() {
  absl::MutexLock lock(&presence_.mutex_);
  const auto calls = presence_.calls_.find(client_);
  CHECK(calls != presence_.calls_.end());
  if (--calls->second == 0) presence_.calls_.erase(calls);
}

bool ClientPresence::alone(ClientId client) const {
  absl::MutexLock lock(&mutex_);
  return calls_.empty() || (calls_.size() == 1 && calls_.begin()->first == client);
}

ClientBudget::Answer ClientBudget::change(ClientId client, uint64_t before, uint64_t bytes,
                                          uint64_t least_share) {
  const bool alone = presence_.alone(client);
  absl::MutexLock lock(&mutex_);
  if (bytes > before) {
    const uint64_t more = bytes - before;
    if (held_ > budget_bytes_ || more > budget_bytes_ - held_) return Answer::kNoRoom;
    const uint64_t holds = held_by(client);
    const uint64_t share = std::max(share_of(client), least_share);
    if (!alone && holds > 0 && holds + more > share) return Answer::kOverShare;
  }
  CHECK(held_ >= before);
  held_ = held_ - before + bytes;
  uint64_t& holds = clients_[client];
  CHECK(holds >= before);
  holds = holds - before + bytes;
  if (holds == 0) clients_.erase(client);
  return Answer::kGranted;
}

uint64_t ClientBudget::held() const {
  absl::MutexLock lock(&mutex_);
  return held_;
}

uint64_t ClientBudget::held(ClientId client) const {
  absl::MutexLock lock(&mutex_);
  return held_by(client);
}

uint64_t ClientBudget::share(ClientId client) const {
  absl::MutexLock lock(&mutex_);
  return share_of(client);
}

uint64_t ClientBudget::held_by(ClientId client) const {
  const auto found = clients_.find(client);
  return found == clients_.end() ? 0 : found->second;
}

uint64_t ClientBudget::share_of(ClientId client) const {
  const uint64_t by_others = held_ - held_by(client);
  return (budget_bytes_ - std::min(budget_bytes_, by_others)) * percent_ / 100;
}

namespace {

// Colour tables may take an eighth of what frames may, and at least this much.
constexpr uint64_t kTablesDivisor = 8;
constexpr uint64_t kLeastTablesBytes = uint64_t{32} << 20;
// Of the frames' budget, for the regions of all clients.
constexpr uint64_t kRegionsDivisor = 4;

}  // namespace

void MemoryPressure::wanted(uint64_t bytes, std::optional<ClientId> within, absl::Time now) {
  absl::MutexLock lock(&mutex_);
  std::erase_if(in_share_, [now](const auto& entry) { return entry.second.until <= now; });
  Wanted& smallest = within ? in_share_[*within] : in_budget_;
  if (smallest.until <= now || bytes <= smallest.bytes) smallest = {bytes, now + kLasts};
}

void MemoryPressure::granted(uint64_t bytes, ClientId client) {
  absl::MutexLock lock(&mutex_);
  if (bytes == in_budget_.bytes) in_budget_ = {};
  const auto in_share = in_share_.find(client);
  if (in_share != in_share_.end() && bytes == in_share->second.bytes) in_share_.erase(in_share);
}

std::optional<uint64_t> MemoryPressure::smallest(absl::Time now) const {
  absl::MutexLock lock(&mutex_);
  return now < in_budget_.until ? std::optional(in_budget_.bytes) : std::nullopt;
}

std::optional<uint64_t> MemoryPressure::smallest(ClientId client, absl::Time now) const {
  std::optional<uint64_t> found = smallest(now);
  absl::MutexLock lock(&mutex_);
  const auto in_share = in_share_.find(client);
  if (in_share == in_share_.end() || in_share->second.until <= now) return found;
  return std::min(found.value_or(in_share->second.bytes), in_share->second.bytes);
}

class ClientMemory::FrameClaim final : public MemoryClaim {
 public:
  FrameClaim(std::shared_ptr<ClientMemory> memory, ClientId client, uint64_t bytes)
      : memory_(std::move(memory)), client_(client), bytes_(bytes) {}
  ~FrameClaim() override { shrink(0); }
  void shrink(uint64_t bytes) override {
    memory_->frames_.change(client_, bytes_, bytes);
    bytes_ = bytes;
  }

 private:
  const std::shared_ptr<ClientMemory> memory_;
  const ClientId client_;
  uint64_t bytes_;
};

ClientMemory::ClientMemory(uint64_t budget_bytes, uint32_t percent, absl::Duration slow_upload)
    : slow_upload_(std::max(slow_upload, kStalled)),
      frames_(budget_bytes, percent, presence_),
      lookahead_(budget_bytes, percent, presence_),
      tables_(std::max(kLeastTablesBytes, budget_bytes / kTablesDivisor), percent, presence_),
      regions_(budget_bytes / kRegionsDivisor, /*percent=*/100, presence_) {}

absl::StatusOr<std::unique_ptr<MemoryClaim>> ClientMemory::claim_frame(ClientId client, uint64_t bytes,
                                                                       absl::Time now) {
  const uint64_t held = frames_.held();
  const uint64_t budget = frames_.budget_bytes();
  const std::optional<uint64_t> waits = pressure_.smallest(now);
  if (waits && *waits < bytes && held + bytes + *waits > budget) {
    return absl::UnavailableError(absl::StrFormat(
        "a frame needs %d bytes, and a smaller one waits for the last of the memory budget of %d; try again "
        "soon, or raise --memory-budget",
        bytes, budget));
  }
  // What a session was promised is a part of its client's share.
  switch (frames_.change(client, 0, bytes, lookahead_.held(client))) {
    case ClientBudget::Answer::kGranted:
      pressure_.granted(bytes, client);
      return std::make_unique<FrameClaim>(shared_from_this(), client, bytes);
    case ClientBudget::Answer::kOverShare:
      pressure_.wanted(bytes, client, now);
      return over_share(frames_, client, bytes, "a frame");
    case ClientBudget::Answer::kNoRoom:
      break;
  }
  pressure_.wanted(bytes, std::nullopt, now);
  return absl::UnavailableError(absl::StrFormat(
      "a frame needs %d bytes, and frames in flight hold %d of the memory budget of %d; try again when they "
      "are done, or raise --memory-budget",
      bytes, held, budget));
}

absl::Status ClientMemory::promise_lookahead(ClientId client, uint64_t before, uint64_t bytes) {
  switch (lookahead_.change(client, before, bytes)) {
    case ClientBudget::Answer::kGranted:
      return absl::OkStatus();
    case ClientBudget::Answer::kOverShare:
      return over_share(lookahead_, client, bytes, "a look-ahead");
    case ClientBudget::Answer::kNoRoom:
      break;
  }
  return absl::UnavailableError(absl::StrFormat(
      "a look-ahead needs %d bytes, and other sessions' look-ahead takes %d of this server's memory budget "
      "of %d; try again when they have ended, use a shorter look-ahead, or raise --memory-budget",
      bytes, lookahead_.held() - before, lookahead_.budget_bytes()));
}

absl::StatusOr<std::shared_ptr<const void>> ClientMemory::claim_table(ClientId client, uint64_t bytes) {
  switch (tables_.change(client, 0, bytes)) {
    case ClientBudget::Answer::kGranted:
      break;
    case ClientBudget::Answer::kOverShare:
      return over_share(tables_, client, bytes, "a colour table");
    case ClientBudget::Answer::kNoRoom:
      return absl::UnavailableError(
          absl::StrFormat("a colour table needs %d bytes, and changes of settings hold %d of the %d bytes "
                          "for tables; announce fewer changes in advance, or raise --memory-budget",
                          bytes, tables_.held(), tables_.budget_bytes()));
  }
  const auto let_go = [memory = shared_from_this(), client, bytes](const void*) {
    memory->tables_.change(client, bytes, 0);
  };
  return std::shared_ptr<const void>(this, let_go);
}

absl::StatusOr<std::shared_ptr<const void>> ClientMemory::claim_region(ClientId client, uint64_t bytes) {
  if (bytes > regions_.budget_bytes()) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("a region has %d bytes, and all regions together at most %d, a quarter of this "
                        "server's memory budget; use a smaller one, or raise --memory-budget",
                        bytes, regions_.budget_bytes()));
  }
  if (regions_.change(client, 0, bytes) != ClientBudget::Answer::kGranted) {
    return absl::UnavailableError(
        absl::StrFormat("a region needs %d bytes, and the others hold %d of the %d "
                        "bytes for regions; send bands, or raise --memory-budget",
                        bytes, regions_.held(), regions_.budget_bytes()));
  }
  const ClientBudget::Answer answer = frames_.change(client, 0, bytes);
  if (answer != ClientBudget::Answer::kGranted) {
    regions_.change(client, bytes, 0);
    if (answer == ClientBudget::Answer::kOverShare) return over_share(frames_, client, bytes, "a region");
    return absl::UnavailableError(
        absl::StrFormat("a region needs %d bytes, and frames hold %d of the "
                        "memory budget of %d; send bands, or raise --memory-budget",
                        bytes, frames_.held(), frames_.budget_bytes()));
  }
  const auto let_go = [memory = shared_from_this(), client, bytes](const void*) {
    memory->frames_.change(client, bytes, 0);
    memory->regions_.change(client, bytes, 0);
  };
  return std::shared_ptr<const void>(this, let_go);
}

absl::Status ClientMemory::check_upload(ClientId client, uint64_t bytes, absl::Duration taken,
                                        absl::Duration silent, absl::Time now) const {
  if (silent < kStalled && taken < slow_upload_) return absl::OkStatus();
  const std::optional<uint64_t> waits = pressure_.smallest(client, now);
  if (!waits || *waits > bytes) return absl::OkStatus();
  if (silent >= kStalled) {
    return absl::UnavailableError(
        absl::StrFormat("the frame brought no pixels for %s while other frames "
                        "waited for its memory, so it lost it; send it again",
                        absl::FormatDuration(absl::Trunc(silent, absl::Milliseconds(1)))));
  }
  return absl::UnavailableError(absl::StrFormat(
      "the frame was not complete after %s while other frames waited for its memory, so it lost it; send it "
      "again, and faster",
      absl::FormatDuration(absl::Trunc(taken, absl::Milliseconds(1)))));
}

absl::Status ClientMemory::over_share(const ClientBudget& budget, ClientId client, uint64_t bytes,
                                      const char* what) const {
  return absl::UnavailableError(absl::StrFormat(
      "%s needs %d bytes, and this client holds %d of its share of %d while others are connected; try again "
      "when its frames are done, or raise --memory-budget or --client-share",
      what, bytes, budget.held(client), budget.share(client)));
}

}  // namespace candela
