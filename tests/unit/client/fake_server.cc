#include "tests/unit/client/fake_server.h"

#include <chrono>
#include <iterator>
#include <map>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

void answer(const v1::FrameHeader& frame, const v1::Settings& settings, Wire& stream) {
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_sequence(frame.sequence());
  header.set_width(frame.width());
  header.set_height(frame.height());
  header.set_format(v1::OUTPUT_FORMAT_RGBA8);
  header.set_resume_token(absl::StrFormat("%d", frame.sequence()));
  stream.Write(response);
  response.mutable_band()->set_first_row(0);
  response.mutable_band()->set_pixels(std::string(
      size_t{frame.width()} * frame.height() * 4,
      static_cast<char>(16 * settings.exposure().manual_ev() + static_cast<double>(frame.sequence()))));
  stream.Write(response);
}

}  // namespace

FakeServer::FakeServer(Fault fault, OpenFault open_fault)
    : fault_(std::move(fault)), open_fault_(std::move(open_fault)) {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
  builder.RegisterService(this);
  server_ = builder.BuildAndStart();
}

FakeServer::~FakeServer() { server_->Shutdown(std::chrono::system_clock::now()); }

std::string FakeServer::address() const { return absl::StrFormat("127.0.0.1:%d", port_); }

std::vector<v1::StreamOpen> FakeServer::opens() {
  const std::lock_guard lock(mutex_);
  return opens_;
}

grpc::Status FakeServer::Stream(grpc::ServerContext* context, Wire* stream) {
  v1::StreamRequest request;
  if (!stream->Read(&request) || !request.has_open()) return {grpc::INVALID_ARGUMENT, "no open"};
  const v1::StreamOpen open = request.open();
  if (context->client_metadata().find("x-session-id")->second != open.session()) {
    return {grpc::INVALID_ARGUMENT, "no x-session-id"};
  }
  size_t before = 0;
  {
    const std::lock_guard lock(mutex_);
    before = opens_.size();
    opens_.push_back(open);
  }
  if (open_fault_) {
    const grpc::Status status = open_fault_(before);
    if (!status.ok()) return status;
  }
  v1::StreamResponse opened;
  opened.mutable_opened()->set_session(open.session());
  opened.mutable_opened()->set_max_frames_in_flight(2);
  stream->Write(opened);
  std::map<uint64_t, v1::Settings> settings{{0, open.settings()}};
  while (stream->Read(&request)) {
    if (request.has_change()) {
      settings[request.change().from_sequence()] = request.change().settings();
      continue;
    }
    if (!request.has_frame()) return {grpc::INVALID_ARGUMENT, "no frame"};
    const v1::FrameHeader frame = request.frame();
    for (uint32_t rows = 0; rows < frame.height();) {
      if (!stream->Read(&request)) return {grpc::INVALID_ARGUMENT, "a frame is cut short"};
      if (request.band().first_row() != rows) return {grpc::INVALID_ARGUMENT, "rows are out of order"};
      rows += static_cast<uint32_t>(request.band().pixels().size() / (frame.width() * 8));
    }
    if (fault_) {
      const grpc::Status status = fault_(frame.sequence(), *stream);
      if (status.error_message() == kEndsAsIfDone.error_message()) return grpc::Status::OK;
      if (!status.ok()) return status;
    }
    answer(frame, std::prev(settings.upper_bound(frame.sequence()))->second, *stream);
  }
  return grpc::Status::OK;
}

}  // namespace candela
