#include "server/rpc/bake_environment_call.h"

#include <Imath/half.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/hash/hash.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "proto/candela/v1/rgb9e5.h"
#include "server/access/client_identity.h"
#include "server/base/slices.h"
#include "server/render/reference/environment_error.h"
#include "server/rpc/wire/parse_request.h"
#include "server/schedule/frame_metrics.h"

namespace candela {
namespace {

// A face's texels on the wire.
std::vector<std::byte> to_wire(const std::vector<float>& rgb, v1::PixelFormat format) {
  const size_t texels = rgb.size() / 3;
  std::vector<std::byte> bytes(texels * bytes_per_pixel(format));
  for (size_t i = 0; i < texels; ++i) {
    const std::array<float, 3> texel{rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]};
    if (format == v1::PIXEL_FORMAT_RGB9E5) {
      const uint32_t word = v1::pack_rgb9e5(texel);
      std::memcpy(&bytes[i * sizeof word], &word, sizeof word);
    } else {
      const std::array<Imath::half, 4> halves{texel[0], texel[1], texel[2], 1.0f};
      std::memcpy(&bytes[i * sizeof halves], halves.data(), sizeof halves);
    }
  }
  return bytes;
}

}  // namespace

struct BakeEnvironmentCall::Work {
  EnvironmentUse environment;
  BakeStart start;
  uint32_t size = 0;  // of level 0
  std::unique_ptr<MemoryClaim> claim;
  TexturePool::Lease host_bytes;  // the part of the budget for `faces`
  v1::BakeHeader header;
  std::vector<std::vector<std::byte>> faces;  // six of each level
  absl::Status status = absl::CancelledError();

  uint64_t face_bytes() const;
  // The memory of the host that the bake needs.
  uint64_t host_memory() const;
  // On the render thread.
  absl::Status bake();
  absl::Status download(const BakedCube& cube);

  std::optional<reference::Scene> panorama;  // if errors are measured
};

// The faces on the wire; for errors also the floats of a level, and the panorama as halves and as floats.
uint64_t BakeEnvironmentCall::Work::host_memory() const {
  if (!start.verify) return face_bytes();
  const uint64_t level = uint64_t{size} * size * kCubeFaces * 3 * sizeof(float);
  const uint64_t texels = uint64_t{environment->facts.width()} * environment->facts.height();
  return face_bytes() + level + texels * (4 * sizeof(uint16_t) + 4 * sizeof(float));
}

// The bytes of all faces on the wire.
uint64_t BakeEnvironmentCall::Work::face_bytes() const {
  uint64_t texels = 0;
  for (uint32_t level = 0; level < start.levels; ++level) {
    const uint64_t side = size >> level;
    texels += side * side * kCubeFaces;
  }
  return texels * bytes_per_pixel(start.format);
}

absl::Status BakeEnvironmentCall::Work::bake() {
  EnvironmentBaker& baker = environment->renderer->baker();
  std::vector<StageTime> stages;
  absl::StatusOr<BakedCube> cube;
  {
    const HostStage stage("bake", &stages);
    cube = baker.bake(environment->environment, start.spec);
    if (!cube.ok()) return cube.status();
  }
  if (start.verify) {
    const absl::StatusOr<std::vector<uint16_t>> halves = baker.read_panorama(environment->environment);
    if (!halves.ok()) return halves.status();
    panorama = panorama_scene(*halves, environment->facts.width(), environment->facts.height());
  }
  {
    const HostStage stage(start.verify ? "verify" : "download", &stages);
    if (absl::Status downloaded = download(*cube); !downloaded.ok()) return downloaded;
  }
  for (const StageTime& stage : stages) {
    v1::StageTime& time = *header.add_stages();
    time.set_name(stage.name);
    time.set_ns(stage.ns);
  }
  return absl::OkStatus();
}

absl::Status BakeEnvironmentCall::Work::download(const BakedCube& cube) {
  EnvironmentBaker& baker = environment->renderer->baker();
  for (uint32_t level = 0; level < start.levels; ++level) {
    std::vector<std::vector<float>> read;
    for (uint32_t face = 0; face < kCubeFaces; ++face) {
      absl::StatusOr<std::vector<float>> rgb = level == 0 ? baker.read_face(cube.chain, cube.first, face)
                                                          : baker.read_face(cube.specular, level - 1, face);
      if (!rgb.ok()) return rgb.status();
      faces.push_back(to_wire(*rgb, start.format));
      if (start.verify) read.push_back(*std::move(rgb));
      checkpoint();
    }
    if (!start.verify) continue;
    v1::BakedLevel& row = *header.mutable_levels(static_cast<int>(level));
    row.set_error(level_error(*panorama, {size >> level, row.roughness(), read}, start.spec.rotation_deg));
  }
  return absl::OkStatus();
}

BakeEnvironmentCall* BakeEnvironmentCall::begin(grpc::CallbackServerContext* context, ServiceState& state) {
  std::shared_ptr<BakeEnvironmentCall> call(new BakeEnvironmentCall(context, state));
  call->start();
  return call.get();
}

BakeEnvironmentCall::BakeEnvironmentCall(grpc::CallbackServerContext* context, ServiceState& state)
    : ServerCall(*context, state.call_gate, state.limits.idle_timeout),
      state_(state),
      client_(absl::HashOf(client_identity(*context, state.limits.tokens))),
      flow_(client_ << 1),
      last_progress_(absl::Now()) {}

void BakeEnvironmentCall::on_entered() {
  visit_.emplace(state_.sessions.memory->presence(), client_);
  watch_idle(idle_timeout());
  StartRead(&incoming_);
}

void BakeEnvironmentCall::OnReadDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  last_progress_ = absl::Now();
  absl::Status status = absl::InvalidArgumentError("call was half-closed before its request");
  if (ok) {
    state_.metrics.bytes_in(incoming_.Length());
    status = take_request();
  }
  if (!status.ok()) finish(status);
}

absl::Status BakeEnvironmentCall::take_request() {
  v1::BakeEnvironmentRequest request;
  if (absl::Status status = parse_request(incoming_, request); !status.ok()) return status;
  absl::StatusOr<BakeStart> start = bake_start_from(request);
  if (!start.ok()) return start.status();
  const std::shared_ptr<Renderer> renderer = state_.rendering.renderer();
  absl::StatusOr<EnvironmentUse> environment = state_.environments.find("id", request.id(), *renderer);
  if (!environment.ok()) return environment.status();
  work_ = std::make_shared<Work>();
  work_->environment = *std::move(environment);
  work_->start = *std::move(start);
  work_->size =
      work_->start.spec.size == 0 ? work_->environment->facts.default_cube_size() : work_->start.spec.size;
  const uint32_t levels = specular_levels(work_->size);
  if (work_->start.levels > levels) {
    return absl::InvalidArgumentError(absl::StrFormat("levels is %d; a cube of %dx%d has %d, down to %dx%d",
                                                      work_->start.levels, work_->size, work_->size, levels,
                                                      kMinCubeSize, kMinCubeSize));
  }
  if (work_->start.levels == 0) work_->start.levels = levels;
  work_->header.set_size(work_->size);
  work_->header.set_tier(request.tier().empty() ? "standard" : request.tier());
  if (absl::Status status = take_memory(); !status.ok()) return status;
  return enqueue();
}

// Counts the bake's textures and its faces on the wire. The baker itself takes the textures.
absl::Status BakeEnvironmentCall::take_memory() {
  EnvironmentBaker& baker = work_->environment->renderer->baker();
  const absl::StatusOr<uint64_t> textures =
      baker.bake_bytes(work_->environment->environment, work_->start.spec);
  if (!textures.ok()) return textures.status();
  absl::StatusOr<std::unique_ptr<MemoryClaim>> claim =
      state_.sessions.memory->claim_frame(client_, *textures + work_->host_memory(), absl::Now());
  if (!claim.ok()) return claim.status();
  work_->claim = *std::move(claim);
  absl::StatusOr<TexturePool::Lease> lease = baker.reserve(work_->host_memory());
  while (absl::IsUnavailable(lease.status()) && state_.environments.free_one()) {
    lease = baker.reserve(work_->host_memory());
  }
  if (!lease.ok()) return lease.status();
  work_->host_bytes = *std::move(lease);
  return absl::OkStatus();
}

absl::Status BakeEnvironmentCall::enqueue() {
  const uint32_t levels = specular_levels(work_->size);
  for (uint32_t level = 0; level < work_->start.levels; ++level) {
    v1::BakedLevel& row = *work_->header.add_levels();
    row.set_size(work_->size >> level);
    row.set_roughness(specular_roughness(level, levels, work_->start.spec.mapping));
  }
  const v1::Environment& facts = work_->environment->facts;
  Harmonics radiance;
  for (int i = 0; i < facts.radiance_sh_size(); ++i) radiance[i / 3][i % 3] = facts.radiance_sh(i);
  for (const auto& coefficient : turned(radiance, work_->start.spec.rotation_deg)) {
    for (const double component : coefficient) work_->header.add_radiance_sh(component);
  }
  FrameJob job;
  job.flow = flow_;
  job.task = [work = work_] { work->status = work->bake(); };
  job.done = [self = self(), work = work_](const absl::StatusOr<RenderedFrame>& ran) {
    absl::MutexLock lock(&self->mutex_);
    if (self->finished()) return;
    if (!ran.ok()) return self->finish(ran.status());
    if (!work->status.ok()) return self->finish(work->status);
    self->at_ = State::kSending;
    self->last_progress_ = absl::Now();
    self->send_next();
  };
  job.deadline = absl::FromChrono(context_.deadline());
  const absl::StatusOr<Ticket> ticket = state_.rendering.loop.submit(std::move(job));
  if (!ticket.ok()) return ticket.status();
  ticket_ = *ticket;
  at_ = State::kQueued;
  return absl::OkStatus();
}

void BakeEnvironmentCall::send_next() {
  if (face_ == work_->faces.size()) return finish(absl::OkStatus());
  v1::BakeEnvironmentResponse response;
  if (!header_sent_) {
    header_sent_ = true;
    *response.mutable_header() = work_->header;
    outgoing_ = v1::pack(response);
  } else if (!face_begun_) {
    face_begun_ = true;
    row_ = 0;
    response.mutable_face()->set_level(face_ / kCubeFaces);
    response.mutable_face()->set_face(face_ % kCubeFaces);
    outgoing_ = v1::pack(response);
  } else {
    const uint32_t side = work_->size >> (face_ / kCubeFaces);
    const uint64_t row_bytes = uint64_t{side} * bytes_per_pixel(work_->start.format);
    const auto rows = static_cast<uint32_t>(std::min<uint64_t>(side - row_, v1::kMaxBandBytes / row_bytes));
    const std::vector<std::byte>& face = work_->faces[face_];
    outgoing_ =
        v1::make_band(v1::kBakeBand, row_, grpc::Slice(face.data() + row_ * row_bytes, rows * row_bytes));
    row_ += rows;
    if (row_ == side) {
      ++face_;
      face_begun_ = false;
    }
  }
  state_.metrics.bytes_out(outgoing_.Length());
  StartWrite(&outgoing_);
}

void BakeEnvironmentCall::OnWriteDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its bake"));
  last_progress_ = absl::Now();
  send_next();
}

void BakeEnvironmentCall::on_finish(const absl::Status& status, const std::string&) {
  if (at_ == State::kQueued) state_.rendering.loop.cancel(ticket_);
  if (!inside()) {
    state_.metrics.rejected(state_.call_gate.closed() ? Rejection::kDraining : Rejection::kCalls);
  } else if (const std::optional<Rejection> reason = rejection_of(status); reason && !status.ok()) {
    state_.metrics.rejected(*reason);
  }
  work_.reset();
  visit_.reset();
}

void BakeEnvironmentCall::on_idle() {
  const absl::Duration idle = absl::Now() - last_progress_;
  if (at_ == State::kQueued) return watch_idle(idle_timeout());
  if (idle < idle_timeout()) return watch_idle(idle_timeout() - idle);
  // A write that nobody reads never ends, and no status could follow it.
  if (at_ == State::kSending) return context_.TryCancel();
  finish(absl::DeadlineExceededError(absl::StrFormat("no request arrived for %s, this server's idle timeout",
                                                     absl::FormatDuration(idle_timeout()))));
}

}  // namespace candela
