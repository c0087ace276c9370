#include "server/rpc/admission.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"

namespace candela {
namespace {

constexpr absl::Duration kRetryInterval = absl::Milliseconds(5);

}  // namespace

void Admission::begin(Request request, Done done) {
  request_ = std::move(request);
  done_ = std::move(done);
  choice_.reset();
  deadline_ = absl::Now() + request_.patience;
  proceed();
}

void Admission::cancel() { done_ = nullptr; }

void Admission::end() {
  cancel();
  alarm_.reset();
  lookahead_memory_.change(std::exchange(reserved_bytes_, 0), 0);
}

void Admission::proceed() {
  if (!done_) return;
  if (request_.choose_tier && !choice_) return choose_tier();
  allocate();
}

void Admission::choose_tier() {
  const absl::Status posted = rendering_.loop.post([this, call = call_.shared_from_this()] {
    std::optional<Request> request;
    call->if_running([&] {
      if (done_) request = request_;
    });
    if (!request) return;
    absl::StatusOr<TierChoice> choice = rendering_.tier_benchmark.choose(request->desc, request->settings);
    call->if_running([&] { on_choice(std::move(choice)); });
  });
  if (!posted.ok()) complete(posted);
}

void Admission::on_choice(absl::StatusOr<TierChoice> choice) {
  if (!done_ || retry_after(choice.status())) return;
  if (!choice.ok()) return complete(choice.status());
  request_.settings = request_.settings.with_tier(choice->tier);
  choice_ = *std::move(choice);
  deadline_ = absl::Now() + request_.patience;
  allocate();
}

void Admission::allocate() {
  const std::shared_ptr<Renderer> renderer = rendering_.renderer();
  absl::StatusOr<FrameMemory> memory = renderer->allocate(request_.desc, request_.settings, request_.verify);
  if (memory.ok()) {
    if (absl::Status status = reserve_lookahead(*memory); !status.ok()) memory = std::move(status);
  }
  if (retry_after(memory.status())) return;
  if (!memory.ok()) return complete(memory.status());
  auto frame = std::make_shared<Frame>(
      Frame{renderer, *std::move(memory), std::move(request_.settings), request_.sequence});
  complete(Admitted{std::move(frame), std::move(choice_)});
}

// Reserves memory for all frames of the look-ahead, each as large as this one.
absl::Status Admission::reserve_lookahead(const FrameMemory& memory) {
  if (request_.lookahead == 0) return absl::OkStatus();
  const FrameDesc& desc = memory.desc();
  const uint64_t wanted = memory.bytes() * (request_.lookahead + 1);
  const uint64_t budget = lookahead_memory_.budget_bytes();
  if (wanted > budget) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a look-ahead of %d frames of %dx%d takes %d bytes and this server's memory budget is %d; use a "
        "look-ahead of at most %d",
        request_.lookahead, desc.width, desc.height, wanted, budget, budget / memory.bytes() - 1));
  }
  if (wanted <= reserved_bytes_) return absl::OkStatus();
  if (!lookahead_memory_.change(reserved_bytes_, wanted)) {
    return absl::UnavailableError(absl::StrFormat(
        "a look-ahead of %d frames of %dx%d takes %d bytes, and other sessions' look-ahead takes %d of this "
        "server's memory budget of %d; try again when they have ended, use a shorter look-ahead, or raise "
        "--memory-budget",
        request_.lookahead, desc.width, desc.height, wanted, lookahead_memory_.reserved() - reserved_bytes_,
        budget));
  }
  reserved_bytes_ = wanted;
  return absl::OkStatus();
}

bool Admission::retry_after(const absl::Status& status) {
  if (!absl::IsUnavailable(status) || absl::Now() >= deadline_) return false;
  alarm_ = call_.if_running_after(kRetryInterval, [this] { proceed(); });
  return true;
}

void Admission::complete(absl::StatusOr<Admitted> outcome) {
  // Cleared first, because `done` may end the call or begin the next frame.
  std::exchange(done_, nullptr)(std::move(outcome));
}

}  // namespace candela
