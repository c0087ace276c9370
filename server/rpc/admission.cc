#include "server/rpc/admission.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr absl::Duration kRetryInterval = absl::Milliseconds(5);
constexpr absl::Duration kTurnInterval = absl::Milliseconds(20);  // far less than a preparation takes

absl::StatusOr<EnvironmentUse> find_environment(const std::string& id, const EnvironmentUse& held,
                                                ServiceState& state) {
  const std::shared_ptr<FrameMaker> renderer = state.rendering.renderer();
  absl::StatusOr<EnvironmentUse> found = state.environments.find("view.environment", id, *renderer);
  const bool is_held = held != nullptr && held->id() == id && held->renderer == renderer;
  if (absl::IsNotFound(found.status()) && is_held) return held;
  return found;
}

}  // namespace

absl::Status use_view(const v1::View& message, const EnvironmentUse& held, ServiceState& state,
                      Admission::Request& request) {
  ASSIGN_OR_RETURN(request.view, view_from(message));
  ASSIGN_OR_RETURN(request.environment, find_environment(message.environment(), held, state));
  request.desc.format = EnvironmentBaker::view_format(request.environment->environment);
  return absl::OkStatus();
}

absl::Status Admission::expect(Request request) {
  request_ = std::move(request);
  stages_.clear();
  ASSIGN_OR_RETURN(const uint64_t bytes,
                   rendering_.renderer()->bytes_for(request_.desc, request_.settings, request_.verify));
  return check_lookahead(bytes);
}

void Admission::begin(Done done) {
  done_ = std::move(done);
  deadline_ = clock_.now() + request_.patience;
  proceed();
}

void Admission::cancel() {
  done_ = nullptr;
  stop_working();
}

void Admission::end() {
  cancel();
  timer_.reset();
  // Less is always granted.
  memory_.promise_lookahead(client_, std::exchange(reserved_bytes_, 0), 0).IgnoreError();
}

void Admission::proceed() {
  if (!done_) return;
  if (request_.environment != nullptr && !request_.environment->ready_for(request_.view))
    return prepare_environment();
  allocate();
}

// What the environment's views read is made when the first of them comes.
void Admission::prepare_environment() {
  const EnvironmentUse environment = request_.environment;
  // Another call prepares it already. Two at once would do the work twice.
  if (environment->preparing.exchange(true)) return proceed_after(kTurnInterval);
  turn_ = {nullptr, [environment](void*) { environment->preparing = false; }};
  const auto stages = std::make_shared<std::vector<StageTime>>();
  const auto prepare = [environment, turn = turn_, stages, objects = !request_.view.objects.empty()] {
    const HostStage bake("bake", stages.get());
    absl::Status status =
        environment->renderer->prepare_view(environment->environment, view_quality(), objects);
    if (status.ok()) environment->sky_ready = true;
    if (status.ok() && objects) environment->objects_ready = true;
    return status;
  };
  work(prepare, [this, stages](const absl::Status& status) {
    for (const StageTime& stage : *stages) add_time(stage, &stages_);
    if (status.ok()) return proceed();
    // The environment went with its device.
    if (request_.environment->renderer != rendering_.renderer()) return complete(status);
    if (absl::IsUnavailable(status) && environments_.free_one()) return proceed();
    if (!retry_after(status)) complete(status);
  });
}

void Admission::work(std::function<absl::Status()> task, std::function<void(const absl::Status&)> then) {
  FrameJob job;
  job.flow = request_.flow;
  job.task = std::move(task);
  job.done = [this, then = std::move(then),
              call = call_.shared_from_this()](const absl::StatusOr<RenderedFrame>& ran) {
    call->if_running([&] {
      if (!done_) return;
      working_.reset();
      turn_.reset();
      then(ran.status());
    });
  };
  const absl::StatusOr<Ticket> ticket = rendering_.loop.submit(std::move(job));
  if (!ticket.ok()) {
    turn_.reset();
    return complete(ticket.status());
  }
  working_ = *ticket;
}

void Admission::stop_working() {
  if (working_) rendering_.loop.cancel(*std::exchange(working_, std::nullopt));
  turn_.reset();
}

void Admission::allocate() {
  const std::shared_ptr<FrameMaker> renderer =
      request_.environment != nullptr ? request_.environment->renderer : rendering_.renderer();
  absl::StatusOr<FrameMemory> memory = take_memory(*renderer);
  if (retry_after(memory.status())) return;
  if (!memory.ok()) return complete(memory.status());
  auto frame = std::make_shared<Frame>(
      Frame{renderer, *std::move(memory), std::move(request_.settings), request_.sequence});
  if (request_.environment != nullptr) {
    frame->long_source = EnvironmentBaker::takes_long(request_.view, request_.desc);
    frame->source = [environment = std::move(request_.environment),
                     view = std::move(request_.view)](FrameMemory& pixels) {
      return environment->renderer->render_view(environment->environment, view, pixels);
    };
  }
  frame->stages = std::exchange(stages_, {});
  complete(std::move(frame));
}

absl::StatusOr<FrameMemory> Admission::take_memory(FrameMaker& renderer) {
  ASSIGN_OR_RETURN(const uint64_t bytes,
                   renderer.bytes_for(request_.desc, request_.settings, request_.verify));
  RETURN_IF_ERROR(reserve_lookahead(bytes));
  ASSIGN_OR_RETURN(std::unique_ptr<MemoryClaim> claim, memory_.claim_frame(client_, bytes, clock_.now()));
  absl::StatusOr<FrameMemory> memory = renderer.allocate(request_.desc, request_.settings, request_.verify);
  // A frame needs memory now. An environment that nobody uses can be sent and baked again.
  while (absl::IsUnavailable(memory.status()) && environments_.free_one()) {
    memory = renderer.allocate(request_.desc, request_.settings, request_.verify);
  }
  if (memory.ok()) memory->account(std::move(claim));
  if (absl::IsUnavailable(memory.status())) memory_.found_no_texture(bytes, clock_.now());
  return memory;
}

absl::Status Admission::check_lookahead(uint64_t frame_bytes) const {
  const uint64_t budget = memory_.budget_bytes();
  const uint64_t wanted = frame_bytes * (request_.lookahead + 1);
  if (request_.lookahead == 0 || wanted <= budget) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrFormat(
      "a look-ahead of %d frames of %dx%d takes %d bytes and this server's memory budget is %d; use a "
      "look-ahead of at most %d",
      request_.lookahead, request_.desc.width, request_.desc.height, wanted, budget,
      budget / frame_bytes - 1));
}

// Reserves memory for all frames of the look-ahead, each as large as this one.
absl::Status Admission::reserve_lookahead(uint64_t frame_bytes) {
  if (request_.lookahead == 0) return absl::OkStatus();
  RETURN_IF_ERROR(check_lookahead(frame_bytes));
  const uint64_t wanted = frame_bytes * (request_.lookahead + 1);
  if (wanted <= reserved_bytes_) return absl::OkStatus();
  if (absl::Status status = memory_.promise_lookahead(client_, reserved_bytes_, wanted); !status.ok()) {
    return status;
  }
  reserved_bytes_ = wanted;
  return absl::OkStatus();
}

bool Admission::retry_after(const absl::Status& status) {
  // Nothing tells this call when memory is free, so it asks again.
  if (!absl::IsUnavailable(status) || clock_.now() >= deadline_) return false;
  proceed_after(kRetryInterval);
  return true;
}

void Admission::proceed_after(absl::Duration delay) {
  timer_ = call_.if_running_after(delay, [this] { proceed(); });
}

void Admission::complete(absl::StatusOr<std::shared_ptr<Frame>> outcome) {
  // Cleared first, because `done` may end the call or begin the next frame.
  std::exchange(done_, nullptr)(std::move(outcome));
}

}  // namespace candela
