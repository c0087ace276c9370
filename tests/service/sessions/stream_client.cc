#include "tests/service/sessions/stream_client.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

#include "proto/candela/v1/limits.h"
#include "tests/support/status.h"

namespace candela::testing {

StreamClient::StreamClient(const std::shared_ptr<grpc::Channel>& channel, bool reads, absl::Time deadline)
    : stub_(v1::RenderService::NewStub(channel)) {
  if (deadline != absl::InfiniteFuture()) context_.set_deadline(absl::ToChronoTime(deadline));
  // gRPC 1.51 may report a connection that is under way as failed (grpc/grpc#35064). Then it connects again.
  context_.set_wait_for_ready(true);
  stream_ = stub_->Stream(&context_);
  if (!reads) return;
  reader_ = std::thread([this] {
    v1::StreamResponse response;
    while (stream_->Read(&response)) {
      absl::MutexLock lock(&mutex_);
      read_.push_back(std::move(response));
    }
    absl::MutexLock lock(&mutex_);
    end_ = true;
  });
}

bool StreamClient::next(v1::StreamResponse& response) {
  if (!reader_.joinable()) return stream_->Read(&response);
  absl::MutexLock lock(&mutex_);
  const auto ready = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return end_ || !read_.empty(); };
  mutex_.Await(absl::Condition(&ready));
  if (read_.empty()) return false;
  response = std::move(read_.front());
  read_.pop_front();
  return true;
}

StreamClient::~StreamClient() {
  if (finished_) return;
  cancel();
  finish();
}

v1::StreamOpen open_of(const std::string& session, const v1::Settings& settings) {
  v1::StreamOpen open;
  open.set_session(session);
  *open.mutable_settings() = settings;
  return open;
}

bool StreamClient::open(const v1::StreamOpen& open) {
  v1::StreamRequest request;
  *request.mutable_open() = open;
  return stream_->Write(request);
}

bool StreamClient::open(const std::string& session, const v1::Settings& settings, const std::string& token) {
  v1::StreamOpen message = open_of(session, settings);
  message.set_resume_token(token);
  return open(message);
}

bool StreamClient::send_header(const WireFrame& frame, uint64_t sequence, int64_t media_time_ns, bool cut,
                               uint32_t timeout_ms) {
  v1::StreamRequest request;
  v1::FrameHeader& header = *request.mutable_frame();
  header.set_sequence(sequence);
  header.set_width(frame.desc.width);
  header.set_height(frame.desc.height);
  header.set_format(static_cast<v1::PixelFormat>(frame.desc.format));
  header.set_media_time_ns(media_time_ns);
  header.set_cut(cut);
  header.set_timeout_ms(timeout_ms);
  return stream_->Write(request);
}

bool StreamClient::send_rows(const WireFrame& frame, uint32_t first, uint32_t count) {
  v1::StreamRequest request;
  request.mutable_band()->set_first_row(first);
  request.mutable_band()->set_pixels(frame.pixels.data() + first * frame.desc.row_bytes(),
                                     count * frame.desc.row_bytes());
  return stream_->Write(request);
}

bool StreamClient::send(const WireFrame& frame, uint64_t sequence, int64_t media_time_ns, bool cut,
                        uint32_t timeout_ms) {
  if (!send_header(frame, sequence, media_time_ns, cut, timeout_ms)) return false;
  const auto rows = static_cast<uint32_t>(v1::kMaxBandBytes / frame.desc.row_bytes());
  for (uint32_t y = 0; y < frame.desc.height; y += rows) {
    if (!send_rows(frame, y, std::min(rows, frame.desc.height - y))) return false;
  }
  return true;
}

bool StreamClient::change(uint64_t from_sequence, const v1::Settings& settings) {
  v1::StreamRequest request;
  request.mutable_change()->set_from_sequence(from_sequence);
  *request.mutable_change()->mutable_settings() = settings;
  return stream_->Write(request);
}

bool StreamClient::read(StreamResult& result) {
  result = {};
  size_t expected = 0;
  bool begun = false;
  v1::StreamResponse response;
  while (!begun || result.pixels.size() < expected) {
    if (!next(response)) return false;
    switch (response.part_case()) {
      case v1::StreamResponse::kOpened:
        opened_ = response.opened();
        break;
      case v1::StreamResponse::kGoAway:
        EXPECT_FALSE(begun) << "in the middle of a result";
        go_away_ = true;
        break;
      case v1::StreamResponse::kFailure:
        EXPECT_FALSE(begun) << "in the middle of a result";
        result.failed = true;
        result.failure = response.failure();
        return true;
      case v1::StreamResponse::kHeader: {
        EXPECT_FALSE(begun) << "in the middle of a result";
        begun = true;
        result.header = response.header();
        const size_t pixel = result.header.format() == v1::OUTPUT_FORMAT_RGBA8 ? 4 : 8;
        expected = result.header.encoded_bytes() > 0
                       ? result.header.encoded_bytes()
                       : size_t{result.header.width()} * result.header.height() * pixel;
        break;
      }
      case v1::StreamResponse::kBand:
        EXPECT_TRUE(begun);
        result.pixels += response.band().pixels();
        break;
      case v1::StreamResponse::kEncoded:
        EXPECT_TRUE(begun);
        result.pixels += response.encoded().data();
        break;
      default:
        ADD_FAILURE() << "an empty message";
        return false;
    }
  }
  EXPECT_EQ(result.pixels.size(), expected);
  return true;
}

std::vector<StreamResult> StreamClient::read_all() {
  std::vector<StreamResult> results;
  StreamResult result;
  while (read(result)) results.push_back(std::move(result));
  return results;
}

grpc::Status StreamClient::finish() {
  v1::StreamResponse response;
  while (next(response)) go_away_ |= response.has_go_away();
  if (reader_.joinable()) reader_.join();
  finished_ = true;
  return stream_->Finish();
}

std::vector<StreamResult> stream_all(const std::shared_ptr<grpc::Channel>& channel,
                                     const v1::StreamOpen& open, const std::vector<WireFrame>& frames) {
  StreamClient client(channel);
  EXPECT_TRUE(client.open(open));
  std::thread writer([&] {
    for (size_t i = 0; i < frames.size(); ++i) client.send(frames[i], i, film_time_ns(i));
    client.half_close();
  });
  std::vector<StreamResult> results = client.read_all();
  writer.join();
  EXPECT_OK(client.finish());
  return results;
}

}  // namespace candela::testing
