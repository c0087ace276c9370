#include "server/rpc/environment_calls.h"

#include <Imath/half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/hash/hash.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/log.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"
#include "server/render/reference/environment_error.h"
#include "server/rpc/band_reader.h"
#include "server/rpc/result_writer.h"
#include "server/schedule/render_loop.h"

namespace candela {

EnvironmentCall::EnvironmentCall(CallTransport& transport, ServiceState& state)
    : ServerCall(transport, state, state.call_gate),
      state_(state),
      client_(absl::HashOf(transport.identity(state.limits.tokens))),
      last_progress_(clock_.now()) {}

void EnvironmentCall::on_entered() {
  visit_.emplace(state_.sessions.memory->presence(), client_);
  watch_idle(std::min(idle_timeout(), ClientMemory::kLookInterval));
  transport_.start_read(&incoming_);
}

void EnvironmentCall::on_read_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  last_progress_ = clock_.now();
  if (ok) state_.metrics.bytes_in(incoming_.Length());
  if (absl::Status status = on_read(ok); !status.ok()) finish(status);
}

absl::Status EnvironmentCall::work(std::function<absl::Status()> task, std::function<void()> then) {
  FrameJob job;
  job.flow = client_ << 1;
  job.task = std::move(task);
  job.done = [call = std::static_pointer_cast<EnvironmentCall>(shared_from_this()),
              then = std::move(then)](const absl::StatusOr<RenderedFrame>& ran) {
    absl::MutexLock lock(&call->mutex_);
    if (call->finished()) return;
    call->ticket_.reset();
    call->last_progress_ = call->clock_.now();
    if (!ran.ok()) return call->finish(ran.status());
    then();
  };
  job.deadline = transport_.deadline();
  ASSIGN_OR_RETURN(ticket_, state_.rendering.loop.submit(std::move(job)));
  return absl::OkStatus();
}

void EnvironmentCall::send(grpc::ByteBuffer message) {
  sending_ = true;
  last_progress_ = clock_.now();
  outgoing_ = std::move(message);
  state_.metrics.bytes_out(outgoing_.Length());
  transport_.start_write(&outgoing_);
}

void EnvironmentCall::on_write_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its answer"));
  last_progress_ = clock_.now();
  on_sent();
}

void EnvironmentCall::on_finish(const absl::Status& status, const std::string&) {
  if (ticket_) state_.rendering.loop.cancel(*ticket_);
  if (!inside()) {
    state_.metrics.rejected(state_.call_gate.closed() ? Rejection::kDraining : Rejection::kCalls);
  } else if (const std::optional<Rejection> reason = rejection_of(status); reason && !status.ok()) {
    state_.metrics.rejected(*reason);
  }
  visit_.reset();
}

void EnvironmentCall::on_idle() {
  const absl::Time now = clock_.now();
  const absl::Duration idle = now - last_progress_;
  if (absl::Status status = check_upload(now, idle); !status.ok()) return finish(status);
  if (ticket_ || idle < idle_timeout()) {
    return watch_idle(std::min(idle_timeout(), ClientMemory::kLookInterval));
  }
  // A write that nobody reads never ends, and no status could follow it.
  if (sending_) return transport_.cancel();
  finish(absl::DeadlineExceededError(
      absl::StrFormat("nothing arrived for %s, this server's idle timeout; send without pauses",
                      absl::FormatDuration(idle_timeout()))));
}

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

namespace {

// Counts in `header` what the format does not hold of the components.
void count_losses(const std::vector<float>& rgb, v1::PixelFormat format, v1::BakeHeader& header) {
  if (format == v1::PIXEL_FORMAT_RGBA32F) return;
  const bool rgb9e5 = format == v1::PIXEL_FORMAT_RGB9E5;
  const auto is_negative = [=](float c) { return rgb9e5 && c < 0; };
  // What is less than half a step above the largest half is rounded to it.
  constexpr float kHalfEnd = shader::MAX_HALF + 16;
  const auto is_clamped = [=](float c) { return rgb9e5 ? c > v1::kMaxRgb9e5 : std::fabs(c) >= kHalfEnd; };
  const auto negative = std::count_if(rgb.begin(), rgb.end(), is_negative);
  const auto clamped = std::count_if(rgb.begin(), rgb.end(), is_clamped);
  header.set_negative_components(header.negative_components() + static_cast<uint64_t>(negative));
  header.set_clamped_components(header.clamped_components() + static_cast<uint64_t>(clamped));
}

Imath::half to_half(float c) { return Imath::half(std::clamp(c, -shader::MAX_HALF, shader::MAX_HALF)); }

// A face's texels on the wire.
std::vector<std::byte> to_wire(const std::vector<float>& rgb, v1::PixelFormat format) {
  const size_t texels = rgb.size() / 3;
  std::vector<std::byte> bytes(texels * bytes_per_pixel(format));
  for (size_t i = 0; i < texels; ++i) {
    const std::array<float, 3> texel{rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]};
    if (format == v1::PIXEL_FORMAT_RGB9E5) {
      const uint32_t word = v1::pack_rgb9e5(texel);
      std::memcpy(&bytes[i * sizeof word], &word, sizeof word);
    } else if (format == v1::PIXEL_FORMAT_RGBA32F) {
      const std::array<float, 4> floats{texel[0], texel[1], texel[2], 1.0f};
      std::memcpy(&bytes[i * sizeof floats], floats.data(), sizeof floats);
    } else {
      const std::array<Imath::half, 4> halves{to_half(texel[0]), to_half(texel[1]), to_half(texel[2]), 1.0f};
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

  uint64_t face_bytes() const;
  // The memory of the host that the bake needs.
  uint64_t host_memory() const;
  // On the render thread.
  absl::Status bake();
  absl::Status download(const BakedCube& cube);

  std::optional<reference::Scene> panorama;  // if errors are measured
};

// The faces on the wire; for errors also the floats of a level, and the panorama.
uint64_t BakeEnvironmentCall::Work::host_memory() const {
  if (!start.verify) return face_bytes();
  const uint64_t level = uint64_t{size} * size * kCubeFaces * 3 * sizeof(float);
  const uint64_t texels = uint64_t{environment->facts.width()} * environment->facts.height();
  return face_bytes() + level + texels * EnvironmentBaker::kReadTexelBytes;
}

// The bytes of all faces on the wire.
uint64_t BakeEnvironmentCall::Work::face_bytes() const {
  uint64_t texels = 0;
  for (uint32_t level = 0; level < start.spec.levels; ++level) {
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
    absl::StatusOr<std::vector<std::array<float, 4>>> texels = baker.read_panorama(environment->environment);
    if (!texels.ok()) return texels.status();
    panorama.emplace(
        reference::Scene{environment->facts.width(), environment->facts.height(), *std::move(texels), {}});
  }
  {
    const HostStage stage(start.verify ? "verify" : "download", &stages);
    RETURN_IF_ERROR(download(*cube));
  }
  add_stages(stages, *header.mutable_stages());
  return absl::OkStatus();
}

absl::Status BakeEnvironmentCall::Work::download(const BakedCube& cube) {
  EnvironmentBaker& baker = environment->renderer->baker();
  for (uint32_t level = 0; level < start.spec.levels; ++level) {
    std::vector<std::vector<float>> read;
    for (uint32_t face = 0; face < kCubeFaces; ++face) {
      ASSIGN_OR_RETURN(std::vector<float> rgb, level == 0 ? baker.read_face(cube.chain, cube.first, face)
                                                          : baker.read_face(cube.specular, level - 1, face));
      count_losses(rgb, start.format, header);
      faces.push_back(to_wire(rgb, start.format));
      if (start.verify) read.push_back(std::move(rgb));
      checkpoint();
    }
    if (!start.verify) continue;
    v1::BakedLevel& row = *header.mutable_levels(static_cast<int>(level));
    row.set_error(level_error(*panorama, {size >> level, row.roughness(), read}, start.spec.rotation_deg));
  }
  return absl::OkStatus();
}

std::shared_ptr<ServerCall> BakeEnvironmentCall::begin(CallTransport& transport, ServiceState& state) {
  std::shared_ptr<BakeEnvironmentCall> call(new BakeEnvironmentCall(transport, state));
  call->start();
  return call;
}

absl::Status BakeEnvironmentCall::on_read(bool message) {
  if (!message) return absl::InvalidArgumentError("call was half-closed before its request");
  return take_request();
}

absl::Status BakeEnvironmentCall::take_request() {
  v1::BakeEnvironmentRequest request;
  RETURN_IF_ERROR(parse_request(incoming_, request));
  work_ = std::make_shared<Work>();
  ASSIGN_OR_RETURN(work_->start, bake_start_from(request));
  const std::shared_ptr<FrameMaker> renderer = state_.rendering.renderer();
  ASSIGN_OR_RETURN(work_->environment, state_.environments.find("id", request.id(), *renderer));
  work_->size =
      work_->start.spec.size == 0 ? work_->environment->facts.default_cube_size() : work_->start.spec.size;
  const uint32_t levels = specular_levels(work_->size);
  if (work_->start.spec.levels > levels) {
    return absl::InvalidArgumentError(absl::StrFormat("levels is %d; a cube of %dx%d has %d, down to %dx%d",
                                                      work_->start.spec.levels, work_->size, work_->size,
                                                      levels, kMinCubeSize, kMinCubeSize));
  }
  if (work_->start.spec.levels == 0) work_->start.spec.levels = levels;
  work_->header.set_size(work_->size);
  work_->header.set_tier(request.tier().empty() ? "standard" : request.tier());
  RETURN_IF_ERROR(take_memory());
  return enqueue();
}

// Counts the bake's textures and its faces on the wire. The baker itself takes the textures.
absl::Status BakeEnvironmentCall::take_memory() {
  EnvironmentBaker& baker = work_->environment->renderer->baker();
  const uint64_t host_bytes = work_->host_memory();
  ASSIGN_OR_RETURN(const uint64_t bytes,
                   baker.bake_bytes(work_->environment->environment, work_->start.spec, host_bytes));
  ASSIGN_OR_RETURN(work_->claim, state_.sessions.memory->claim_frame(client_, bytes, clock_.now()));
  absl::StatusOr<TexturePool::Lease> lease = baker.reserve(host_bytes);
  while (absl::IsUnavailable(lease.status()) && state_.environments.free_one()) {
    lease = baker.reserve(host_bytes);
  }
  if (!lease.ok()) return lease.status();
  work_->host_bytes = *std::move(lease);
  return absl::OkStatus();
}

absl::Status BakeEnvironmentCall::enqueue() {
  const uint32_t levels = specular_levels(work_->size);
  for (uint32_t level = 0; level < work_->start.spec.levels; ++level) {
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
  return work([work = work_] { return work->bake(); }, [this] { on_sent(); });
}

// Sends the next message: the header, then for each face its place and its rows.
void BakeEnvironmentCall::on_sent() {
  if (face_ == work_->faces.size()) return finish(absl::OkStatus());
  v1::BakeEnvironmentResponse response;
  if (!header_sent_) {
    header_sent_ = true;
    *response.mutable_header() = work_->header;
    return send(v1::pack(response));
  }
  if (!face_begun_) {
    face_begun_ = true;
    row_ = 0;
    response.mutable_face()->set_level(face_ / kCubeFaces);
    response.mutable_face()->set_face(face_ % kCubeFaces);
    return send(v1::pack(response));
  }
  const uint32_t side = work_->size >> (face_ / kCubeFaces);
  const uint64_t row_bytes = uint64_t{side} * bytes_per_pixel(work_->start.format);
  const auto rows = static_cast<uint32_t>(std::min<uint64_t>(side - row_, v1::kMaxBandBytes / row_bytes));
  const std::vector<std::byte>& face = work_->faces[face_];
  const grpc::Slice pixels(face.data() + row_ * row_bytes, rows * row_bytes);
  grpc::ByteBuffer band = v1::make_band(v1::kBakeBand, row_, pixels);
  row_ += rows;
  if (row_ == side) {
    ++face_;
    face_begun_ = false;
  }
  send(std::move(band));
}

void BakeEnvironmentCall::on_finish(const absl::Status& status, const std::string& message) {
  EnvironmentCall::on_finish(status, message);
  work_.reset();
}

}  // namespace candela
