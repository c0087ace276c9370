#include "server/rpc/environments/bake_environment_call.h"

#include <Imath/half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"
#include "server/render/reference/environment_error.h"
#include "server/rpc/wire/parse_request.h"
#include "server/rpc/wire/result_writer.h"

namespace candela {
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
