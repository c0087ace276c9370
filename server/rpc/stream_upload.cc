// A stream's frames on their way in: when they get memory, which are passed over, and when they take too
// long.
#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/rpc/stream_call.h"

namespace candela {
namespace {

std::string to_words(absl::Duration duration) {
  return absl::FormatDuration(absl::Trunc(duration, absl::Milliseconds(1)));
}

}  // namespace

void StreamCall::admit() {
  reading_ = Reading::kAdmission;
  admission_.begin([this](absl::StatusOr<std::shared_ptr<Frame>> admitted)
                       ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { on_admitted(std::move(admitted)); });
}

absl::Status StreamCall::pass_over(const v1::FrameHeader& header, const WireLayout& layout) {
  open_->frames.add_passed(header.sequence(), layout, open_->settings.now().hash);
  if (has_no_bands(header)) {
    end_passed();
    return absl::OkStatus();
  }
  bands_.emplace(v1::kStreamFrameBand, layout, clock_);
  open_->frames.newest()->begun = clock_.now();
  reading_ = Reading::kPassing;
  return absl::OkStatus();
}

absl::Status StreamCall::take_passed(grpc::ByteBuffer& message) {
  absl::Status status = bands_->pass(message);
  if (!status.ok() || !bands_->complete()) return status;
  bands_.reset();
  end_passed();
  return absl::OkStatus();
}

void StreamCall::end_passed() {
  reading_ = Reading::kBetween;
  SessionFrames::passed(*open_->frames.newest());
  write_on();
}

void StreamCall::on_idle() {
  const absl::Time now = clock_.now();
  const absl::Duration timeout = idle_timeout();
  // A write that nobody reads never ends, and no status could follow it.
  if (write_pending_ && now - last_write_ >= timeout) return transport_.cancel();
  if (reading_ == Reading::kBands || reading_ == Reading::kPassing) {
    const Entry& entry = *open_->frames.newest();
    const absl::Status slow =
        check_upload_time(absl::StrFormat("frame %d", entry.sequence), now - entry.begun);
    if (!slow.ok()) return give_up_on_client(slow);
  }
  if (reading_ == Reading::kBands) {
    const Entry& entry = *open_->frames.newest();
    const absl::Status yield = state_.sessions.memory->check_upload(client_, entry.frame->memory.bytes(),
                                                                    now - entry.begun, now - last_read_, now);
    if (!yield.ok()) {
      read_no_more(yield);
      if (finished()) return;
    }
  }
  const bool busy = write_pending_ || (open_ && open_->frames.busy());
  // If the session is full of frames that wait for later ones, nothing is read, and that is idle too.
  const bool may_arrive = read_pending_ || reading_ == Reading::kBetween;
  if (may_arrive && !busy && now - std::max(last_read_, last_write_) >= timeout) {
    return give_up_on_client(idle_for(timeout));
  }
  watch_idle(std::min(timeout / 2, ClientMemory::kLookInterval));
}

void StreamCall::give_up_on_client(const absl::Status& status) {
  if (open_) release(open_->frames.drop_all(), absl::CancelledError());
  finish(status);
}

// A session that paused may go on with its token; a call that never became one has none.
absl::Status StreamCall::idle_for(absl::Duration timeout) const {
  if (!open_) {
    return absl::DeadlineExceededError(absl::StrFormat(
        "nothing arrived for %s, this server's idle timeout; send the open message", to_words(timeout)));
  }
  return absl::UnavailableError(
      absl::StrFormat("nothing arrived for %s, this server's idle timeout; resume the session with its last "
                      "resume token when there is a frame to send",
                      to_words(timeout)));
}

}  // namespace candela
