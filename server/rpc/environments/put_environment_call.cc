#include "server/rpc/environments/put_environment_call.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/log.h"
#include "server/base/status_macros.h"
#include "server/rpc/wire/parse_request.h"
#include "server/rpc/wire/result_writer.h"

namespace candela {

struct PutEnvironmentCall::Work {
  std::shared_ptr<FrameMaker> renderer;
  std::unique_ptr<MemoryClaim> claim;  // of the upload
  EnvironmentRoom room;
  std::optional<PanoramaUpload> upload;
  PanoramaStart start;
  v1::Environment facts;
  EnvironmentUse environment;
  std::vector<StageTime> stages;
  EnvironmentStore* store = nullptr;

  // On the render thread.
  absl::Status run();
  absl::StatusOr<EnvironmentUse> ingest();
  // Room for a panorama of `bytes`, instead of what there is.
  absl::Status grow(uint64_t bytes);
};

absl::Status PutEnvironmentCall::Work::run() {
  absl::StatusOr<EnvironmentUse> made = ingest();
  upload.reset();
  claim.reset();
  if (made.ok()) environment = *std::move(made);
  return made.status();
}

absl::Status PutEnvironmentCall::Work::grow(uint64_t bytes) {
  const uint64_t wanted = environment_bytes(facts.width(), bytes);
  RETURN_IF_ERROR(store->check_size(wanted));
  ASSIGN_OR_RETURN(EnvironmentRoom more, store->make_room(wanted - room.bytes()));
  room.add(std::move(more));
  facts.set_memory_bytes(room.bytes());
  return absl::OkStatus();
}

absl::StatusOr<EnvironmentUse> PutEnvironmentCall::Work::ingest() {
  EnvironmentBaker& baker = renderer->baker();
  auto kept = std::make_shared<KeptEnvironment>();
  {
    const HostStage stage("panorama", &stages);
    ASSIGN_OR_RETURN(kept->environment,
                     baker.finish(
                         *std::move(upload), start.to_scene, [this](uint64_t bytes) { return grow(bytes); },
                         [this] { return store->free_one(); }));
  }
  const PanoramaBadValues& bad = kept->environment.bad;
  if (start.reject_bad && bad.first_bad_texel) {
    const uint32_t width = kept->environment.width;
    return absl::InvalidArgumentError(
        absl::StrFormat("pixel (%d, %d) of the panorama is NaN, Inf or beyond 2^30, and bad_values is "
                        "REJECT; use SCRUB or mend the file",
                        *bad.first_bad_texel % width, *bad.first_bad_texel / width));
  }
  {
    const HostStage stage("panorama_sh", &stages);
    ASSIGN_OR_RETURN(const Harmonics radiance, baker.radiance(kept->environment));
    for (const auto& coefficient : radiance) {
      for (const double component : coefficient) facts.add_radiance_sh(component);
    }
  }
  facts.set_nan_components(bad.nan);
  facts.set_infinite_components(bad.infinite);
  facts.set_negative_components(bad.negative);
  facts.set_clamped_components(bad.clamped);
  kept->facts = facts;
  kept->room = std::move(room);
  kept->renderer = renderer;
  return kept;
}

std::shared_ptr<ServerCall> PutEnvironmentCall::begin(CallTransport& transport, ServiceState& state) {
  std::shared_ptr<PutEnvironmentCall> call(new PutEnvironmentCall(transport, state));
  call->start();
  return call;
}

absl::Status PutEnvironmentCall::on_read(bool message) {
  if (!message) return take_half_close();
  if (reading_ == State::kStart) return take_start();
  if (reading_ == State::kFirstBand) {
    RETURN_IF_ERROR(take_memory());
  }
  return take_band();
}

absl::Status PutEnvironmentCall::take_start() {
  v1::PutEnvironmentRequest request;
  RETURN_IF_ERROR(parse_request(incoming_, request));
  incoming_.Clear();
  if (!request.has_start()) {
    return absl::InvalidArgumentError("first message holds no `start`; send it before the bands");
  }
  RETURN_IF_ERROR(state_.rendering.renderer()->check_environments());
  ASSIGN_OR_RETURN(PanoramaStart start, panorama_start_from(request.start(), state_.limits.frame));
  // What can never fit is refused before a pixel is read.
  const FrameDesc& desc = start.layout.desc;
  constexpr uint64_t kPanoramaTexelBytes = 8;
  const uint64_t bytes = environment_bytes(desc.width, kPanoramaTexelBytes * desc.width * desc.height);
  RETURN_IF_ERROR(state_.environments.check_size(bytes));
  start_ = std::move(start);
  id_.emplace(request.start());
  bands_.emplace(v1::kPanoramaBand, start_->layout, clock_,
                 [this](absl::Duration took) { state_.rendering.loop.charge(client_ << 1, took); });
  reading_ = State::kFirstBand;
  transport_.start_read(&incoming_);
  return absl::OkStatus();
}

absl::Status PutEnvironmentCall::take_memory() {
  const FrameDesc& desc = start_->layout.desc;
  auto work = std::make_shared<Work>();
  work->renderer = state_.rendering.renderer();
  work->start = *start_;
  work->store = &state_.environments;
  absl::StatusOr<PanoramaUpload> upload = work->renderer->baker().take(desc);
  while (absl::IsUnavailable(upload.status()) && state_.environments.free_one()) {
    upload = work->renderer->baker().take(desc);
  }
  if (!upload.ok()) return upload.status();
  ASSIGN_OR_RETURN(work->room,
                   state_.environments.make_room(environment_bytes(desc.width, upload->kept_bytes())));
  ASSIGN_OR_RETURN(work->claim, state_.sessions.memory->claim_frame(client_, upload->bytes(), clock_.now()));
  work->upload = *std::move(upload);
  work_ = std::move(work);
  reading_ = State::kBands;
  admitted_ = clock_.now();
  return absl::OkStatus();
}

// The memory of an upload may be uncached, so the rows are hashed where they arrive.
absl::Status PutEnvironmentCall::take_band() {
  const uint64_t row_bytes = start_->layout.desc.row_bytes();
  rows_.resize(std::min(v1::kMaxBandBytes, start_->layout.desc.bytes()));
  const uint32_t first = rows_read_;
  const auto place = [&](uint32_t y) {
    rows_read_ = y + 1;
    return std::span(rows_).subspan((y - first) * row_bytes, row_bytes);
  };
  absl::Status status = bands_->read(incoming_, place);
  incoming_.Clear();
  if (!status.ok()) return status;
  for (uint32_t y = first; y < rows_read_; ++y) {
    const std::span<const std::byte> row = std::span(rows_).subspan((y - first) * row_bytes, row_bytes);
    id_->add(row);
    std::memcpy(work_->upload->row(y).data(), row.data(), row_bytes);
  }
  transport_.start_read(&incoming_);
  return absl::OkStatus();
}

absl::Status PutEnvironmentCall::take_half_close() {
  // gRPC reports a client that vanished as one that half-closed.
  if (transport_.is_cancelled()) return absl::CancelledError("call was cancelled");
  if (!bands_) return absl::InvalidArgumentError("call was half-closed before its start message");
  RETURN_IF_ERROR(bands_->check_complete());
  rows_ = {};
  const FrameDesc& desc = start_->layout.desc;
  v1::Environment& facts = work_->facts;
  facts.set_id(id_->finish());
  facts.set_width(desc.width);
  facts.set_height(desc.height);
  facts.set_default_cube_size(default_cube_size(desc.width));
  facts.set_memory_bytes(work_->room.bytes());
  absl::StatusOr<EnvironmentUse> known = state_.environments.find("id", facts.id(), *work_->renderer);
  if (!known.ok()) return enqueue();
  work_.reset();
  v1::Environment environment = (*known)->facts;
  known->reset();  // nobody uses it any more when the client has its answer
  environment.set_had_it(true);
  answer(environment);
  return absl::OkStatus();
}

absl::Status PutEnvironmentCall::enqueue() {
  reading_ = State::kWhole;
  return work([work = work_] { return work->run(); },
              [this, work = work_] {
                v1::Environment environment = state_.environments.keep(std::move(work->environment))->facts;
                add_stages(work->stages, *environment.mutable_stages());
                answer(environment);
              });
}

void PutEnvironmentCall::answer(const v1::Environment& environment) {
  log_event(LogLevel::kInfo, "environment put",
            {{"peer", transport_.peer()},
             {"id", environment.id()},
             {"had_it", environment.had_it() ? "yes" : "no"}});
  reading_ = State::kWhole;
  send(v1::pack(environment));
}

void PutEnvironmentCall::on_sent() { finish(absl::OkStatus()); }

void PutEnvironmentCall::on_finish(const absl::Status& status, const std::string& message) {
  EnvironmentCall::on_finish(status, message);
  if (!status.ok()) {
    log_event(LogLevel::kInfo, "environment not put",
              {{"peer", transport_.peer()},
               {"status", absl::StatusCodeToString(status.code())},
               {"message", message}});
  }
  work_.reset();
}

absl::Status PutEnvironmentCall::check_upload(absl::Time now, absl::Duration idle) {
  if (reading_ != State::kBands) return absl::OkStatus();
  const absl::Duration taken = now - admitted_;
  RETURN_IF_ERROR(check_upload_time("the panorama", taken));
  return state_.sessions.memory->check_upload(client_, work_->upload->bytes(), taken, idle, now);
}

}  // namespace candela
