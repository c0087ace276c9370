#include "client/environment.h"

#include <utility>

#include "client/call/raw_call.h"
#include "client/call/result_reader.h"
#include "client/connection.h"
#include "proto/candela/v1/environment_id.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr uint32_t kFaces = 6;

absl::StatusOr<v1::Environment> upload(const std::shared_ptr<grpc::Channel>& channel, const Peer& peer,
                                       const Panorama& panorama, absl::Time deadline) {
  RawCall call(channel, "/candela.v1.RenderService/PutEnvironment", deadline);
  v1::PutEnvironmentRequest request;
  *request.mutable_start() = panorama.start;
  request.mutable_start()->set_total_bytes(panorama.pixels.size());
  const uint64_t row_bytes = uint64_t{panorama.start.width()} * bytes_per_pixel(panorama.start.format());
  grpc::ByteBuffer message;
  const bool answered = call.write(v1::pack(request)) &&
                        send_bands(call, v1::kPanoramaBand, row_bytes, panorama.pixels) &&
                        call.half_close() && call.read(message);
  return answer_of<v1::Environment>(call, answered, message, peer);
}

// Reads one bake, message by message.
class BakeReader {
 public:
  explicit BakeReader(v1::PixelFormat format) { baked_.format = format; }

  absl::Status read(grpc::ByteBuffer& message) {
    if (!faces_.empty() && !bands_.whole()) return bands_.take(message);
    v1::BakeEnvironmentResponse response;
    if (!v1::unpack(message, response)) return not_the_protocol("it cannot be read");
    if (response.has_header() && baked_.levels.empty()) return take_header(response.header());
    if (response.has_face() && !baked_.levels.empty()) return take_face(response.face());
    return not_the_protocol("a message of a bake is out of place");
  }

  absl::StatusOr<EnvironmentBake> take() {
    if (baked_.levels.empty() || faces_.size() != baked_.levels.size() * kFaces || !bands_.whole()) {
      return not_the_protocol("it ended before the last face");
    }
    return std::move(baked_);
  }

 private:
  absl::Status take_header(const v1::BakeHeader& header) {
    uint32_t size = header.size();
    if (size > v1::kCubeSize.max) return not_the_protocol("the size of a bake");
    for (const v1::BakedLevel& level : header.levels()) {
      if (size == 0 || level.size() != size) return not_the_protocol("the size of a bake's level");
      baked_.levels.emplace_back(face_bytes(level) * kFaces);
      size /= 2;
    }
    baked_.header = header;
    return baked_.levels.empty() ? not_the_protocol("a bake without levels") : absl::OkStatus();
  }

  absl::Status take_face(const v1::BakeFace& face) {
    const auto next = static_cast<uint32_t>(faces_.size());
    if (face.level() != next / kFaces || face.face() != next % kFaces ||
        face.level() >= baked_.levels.size()) {
      return not_the_protocol("its faces are out of order");
    }
    const v1::BakedLevel& level = baked_.header.levels(static_cast<int>(face.level()));
    std::vector<std::byte>& bytes = baked_.levels[face.level()];
    bands_.begin(std::span(bytes).subspan(face.face() * face_bytes(level), face_bytes(level)),
                 row_bytes(level));
    faces_.push_back(face);
    return absl::OkStatus();
  }

  uint64_t row_bytes(const v1::BakedLevel& level) const {
    return uint64_t{level.size()} * bytes_per_pixel(baked_.format);
  }
  uint64_t face_bytes(const v1::BakedLevel& level) const { return row_bytes(level) * level.size(); }

  EnvironmentBake baked_;
  std::vector<v1::BakeFace> faces_;  // that have begun
  IncomingBands bands_{v1::kBakeBand};
};

}  // namespace

absl::Status check_panorama(const Panorama& panorama) {
  return check_frame(panorama.start.width(), panorama.start.height(), panorama.start.format(),
                     panorama.pixels.size());
}

std::string environment_id(const Panorama& panorama) {
  v1::EnvironmentId id(panorama.start);
  id.add(panorama.pixels);
  return id.finish();
}

absl::StatusOr<v1::Environment> Connection::put_environment(const Panorama& panorama,
                                                            absl::Time deadline) const {
  RETURN_IF_ERROR(check_panorama(panorama));
  absl::StatusOr<v1::Environment> known = get_environment(environment_id(panorama), deadline);
  if (!absl::IsNotFound(known.status())) return known;
  return upload(channel_, peer_, panorama, deadline);
}

absl::StatusOr<v1::Environment> Connection::get_environment(const std::string& id,
                                                            absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/GetEnvironment", deadline);
  v1::GetEnvironmentRequest request;
  request.set_id(id);
  return ask<v1::Environment>(call, request, peer_);
}

absl::StatusOr<EnvironmentBake> Connection::bake_environment(const v1::BakeEnvironmentRequest& request,
                                                             absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/BakeEnvironment", deadline);
  BakeReader reader(request.format());
  grpc::ByteBuffer message;
  const bool sent = call.write(v1::pack(request)) && call.half_close();
  while (sent && call.read(message)) {
    RETURN_IF_ERROR(reader.read(message));
  }
  RETURN_IF_ERROR(end_of(call, peer_));
  return reader.take();
}

absl::StatusOr<v1::DropEnvironmentResponse> Connection::drop_environment(const std::string& id,
                                                                         absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/DropEnvironment", deadline);
  v1::DropEnvironmentRequest request;
  request.set_id(id);
  return ask<v1::DropEnvironmentResponse>(call, request, peer_);
}

}  // namespace candela
