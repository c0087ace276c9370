#include "client/connection.h"

#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/channel_arguments.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "client/raw_call.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

uint64_t bytes_per_pixel(v1::PixelFormat format) {
  switch (format) {
    case v1::PIXEL_FORMAT_RGBA16F:
      return 8;
    case v1::PIXEL_FORMAT_RGBA32F:
      return 16;
    case v1::PIXEL_FORMAT_RGB9E5:
      return 4;
    default:
      return 0;
  }
}

bool is_address(const std::string& address) {
  if (absl::StartsWith(address, "unix:")) return address.size() > 5;
  const size_t colon = address.rfind(':');
  uint32_t port = 0;
  return colon != std::string::npos && colon != 0 && address.find('/') == std::string::npos &&
         absl::SimpleAtoi(address.substr(colon + 1), &port) && port >= 1 && port <= 65535;
}

// The one place where gRPC's errors become ours. `connected`: a message reached the server.
absl::Status from_grpc(const grpc::Status& status, const std::string& address, bool connected) {
  if (status.ok()) return absl::OkStatus();
  const absl::Status plain(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
  const std::string message(plain.message().empty() ? absl::StatusCodeToString(plain.code())
                                                    : std::string(plain.message()));
  switch (status.error_code()) {
    case grpc::UNAVAILABLE:
      // A server's own refusal carries details; without any it is the transport's.
      if (!status.error_details().empty()) break;
      if (connected) {
        return absl::UnavailableError(absl::StrFormat(
            "lost the server at %s: %s; it may have stopped, so look at its log and try again", address,
            message));
      }
      return absl::UnavailableError(
          absl::StrFormat("cannot reach %s: %s; start one with candelad --listen %s or leave out --server",
                          address, message, address));
    case grpc::CANCELLED:
      // This side never cancels: a server does, by gRPC when it stops or when its idle timeout is over.
      return absl::UnavailableError(
          absl::StrFormat("the server at %s ended the call: it is stopping, or this side read nothing for "
                          "longer than its --idle-timeout; try again",
                          address));
    case grpc::UNIMPLEMENTED:
      return absl::UnimplementedError(
          absl::StrFormat("%s does not speak candela.v1: %s; is it a candelad?", address, message));
    case grpc::DEADLINE_EXCEEDED:
      if (message != "Deadline Exceeded") break;
      return absl::DeadlineExceededError(
          absl::StrFormat("no answer from %s in the time given; give it more", address));
    default:
      break;
  }
  return absl::Status(plain.code(), message);
}

grpc::ByteBuffer serialize(const google::protobuf::Message& message) {
  const grpc::Slice bytes(message.SerializeAsString());
  return grpc::ByteBuffer(&bytes, 1);
}

bool parse(grpc::ByteBuffer& bytes, google::protobuf::Message& message) {
  grpc::ProtoBufferReader slices(&bytes);
  return message.ParseFromZeroCopyStream(&slices);
}

grpc::ByteBuffer start_message(const v1::Settings& settings, const FrameView& frame) {
  v1::RenderRequest request;
  *request.mutable_start()->mutable_settings() = settings;
  if (frame.previous) *request.mutable_start()->mutable_previous() = *frame.previous;
  v1::FrameHeader& header = *request.mutable_start()->mutable_frame();
  header.set_sequence(frame.sequence);
  header.set_width(frame.width);
  header.set_height(frame.height);
  header.set_format(frame.format);
  header.set_total_bytes(frame.pixels.size());
  request.mutable_start()->set_verify(frame.verify);
  request.mutable_start()->set_error_map(frame.error_map);
  return serialize(request);
}

// gRPC may hold on to a message after its call has ended, so a band is copied and not referred to.
bool send_bands(RawCall& call, const FrameView& frame) {
  const uint64_t row_bytes = frame.width * bytes_per_pixel(frame.format);
  if (row_bytes == 0) return true;
  const uint64_t rows = std::max<uint64_t>(1, v1::kMaxBandBytes / row_bytes);
  for (uint64_t y = 0; y < frame.height; y += rows) {
    const uint64_t bytes = std::min<uint64_t>(rows, frame.height - y) * row_bytes;
    const grpc::Slice pixels(frame.pixels.data() + y * row_bytes, bytes);
    if (!call.write(v1::make_band(v1::kFrameBand, static_cast<uint32_t>(y), pixels))) return false;
  }
  return true;
}

template <typename Response>
absl::StatusOr<Response> ask(RawCall& call, const google::protobuf::Message& request,
                             const std::string& address) {
  grpc::ByteBuffer message;
  const bool answered = call.write(serialize(request)) && call.half_close() && call.read(message);
  if (absl::Status status = from_grpc(call.finish(), address, call.connected()); !status.ok()) return status;
  Response response;
  if (!answered || !parse(message, response)) return not_the_protocol("it cannot be read");
  return response;
}

}  // namespace

absl::StatusOr<Connection> Connection::open(const std::string& address) {
  if (!is_address(address)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("server address '%s' is neither HOST:PORT (port 1 .. 65535) nor unix:PATH", address));
  }
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY,
                   0);  // the address is the server's, whatever the environment says
  arguments.SetMaxReceiveMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  return Connection(grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments),
                    address);
}

Connection::Connection(std::shared_ptr<grpc::Channel> channel)
    : Connection(std::move(channel), "this process") {}

Connection::Connection(std::shared_ptr<grpc::Channel> channel, std::string address)
    : channel_(std::move(channel)), address_(std::move(address)) {}

absl::StatusOr<RenderResult> Connection::render(const v1::Settings& settings, const FrameView& frame,
                                                absl::Time deadline) const {
  if (frame.width == 0 || frame.height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame is %dx%d pixels and has to be at least 1x1", frame.width, frame.height));
  }
  if (frame.pixels.size() != uint64_t{frame.width} * frame.height * bytes_per_pixel(frame.format)) {
    return absl::InvalidArgumentError(absl::StrFormat("%dx%d pixels of %s are not %d bytes", frame.width,
                                                      frame.height, v1::PixelFormat_Name(frame.format),
                                                      frame.pixels.size()));
  }
  RawCall call(channel_, "/candela.v1.RenderService/Render", deadline);
  grpc::ByteBuffer message;
  const bool sent =
      call.write(start_message(settings, frame)) && send_bands(call, frame) && call.half_close();
  if (sent && frame.on_sent) frame.on_sent();
  if (!sent || !call.read(message)) {
    const absl::Status status = from_grpc(call.finish(), address_, call.connected());
    return status.ok() ? not_the_protocol("it ended before its header") : status;
  }
  ResultReader reader({frame.width, frame.height, frame.verify, frame.error_map});
  do {
    if (absl::Status status = reader.read(message); !status.ok()) return status;
  } while (call.read(message));
  if (absl::Status status = from_grpc(call.finish(), address_, true); !status.ok()) return status;
  return reader.take();
}

absl::StatusOr<v1::GetServerInfoResponse> Connection::server_info(absl::Time deadline) const {
  RawCall call(channel_, "/candela.v1.RenderService/GetServerInfo", deadline);
  return ask<v1::GetServerInfoResponse>(call, v1::GetServerInfoRequest(), address_);
}

absl::Status Connection::health(absl::Time deadline) const {
  // grpc.health.v1's request (string service = 1) and response (enum status = 1) have the bytes of these.
  constexpr int kServing = 1;
  RawCall call(channel_, "/grpc.health.v1.Health/Check", deadline);
  const absl::StatusOr<google::protobuf::Int32Value> status =
      ask<google::protobuf::Int32Value>(call, google::protobuf::StringValue(), address_);
  if (!status.ok()) return status.status();
  if (status->value() == kServing) return absl::OkStatus();
  return absl::UnavailableError(absl::StrFormat(
      "the server at %s is up but not serving: it is starting or draining; try again or use another one",
      address_));
}

}  // namespace candela
