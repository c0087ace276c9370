#include "tests/service/clients.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <thread>

#include "absl/time/clock.h"
#include "proto/candela/v1/limits.h"
#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

void reset(int socket) {
  const linger now{1, 0};
  setsockopt(socket, SOL_SOCKET, SO_LINGER, &now, sizeof(now));
  close(socket);
}

// One direction.
class Lane {
 public:
  Lane(int from, int to, const std::atomic<double>& bytes_per_second)
      : from_(from), to_(to), bytes_per_second_(bytes_per_second) {}

  // Waits for bytes only while the limit allows some to pass.
  pollfd awaited() {
    const absl::Time now = absl::Now();
    const double rate = bytes_per_second_;
    // Never more than it takes to keep up between two calls.
    may_pass_ = std::min(may_pass_ + rate * absl::ToDoubleSeconds(now - earned_), std::max(1.0, rate / 10));
    earned_ = now;
    return {may_pass_ >= 1 ? from_ : -1, POLLIN, 0};
  }

  // Returns how many bytes passed, or 0 when either end has ended.
  size_t pass() {
    const size_t most = std::min(bytes_.size(), static_cast<size_t>(may_pass_));
    const ssize_t size = recv(from_, bytes_.data(), most, 0);
    if (size <= 0 || send(to_, bytes_.data(), static_cast<size_t>(size), MSG_NOSIGNAL) != size) return 0;
    may_pass_ -= static_cast<double>(size);
    return static_cast<size_t>(size);
  }

 private:
  const int from_;
  const int to_;
  const std::atomic<double>& bytes_per_second_;
  double may_pass_ = 0;  // bytes
  absl::Time earned_ = absl::Now();
  std::array<char, 65536> bytes_;
};

}  // namespace

WireCutter::WireCutter(const std::string& server_address) : listener_(socket(AF_INET, SOCK_STREAM, 0)) {
  sockaddr_in address = loopback(0);
  bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof(address));
  listen(listener_, 1);
  socklen_t size = sizeof(address);
  getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
  address_ = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  const int server_port = std::stoi(server_address.substr(server_address.rfind(':') + 1));
  thread_ = std::thread([this, server_port] { run(server_port); });
}

WireCutter::~WireCutter() {
  cut_ = true;
  if (thread_.joinable()) thread_.join();
  close(listener_);
}

void WireCutter::cut() {
  cut_ = true;
  thread_.join();
}

void WireCutter::run(int server_port) {
  pollfd incoming{listener_, POLLIN, 0};
  while (poll(&incoming, 1, 10) == 0) {
    if (cut_) return;
  }
  const int client = accept(listener_, nullptr, nullptr);
  const int server = socket(AF_INET, SOCK_STREAM, 0);
  const int buffer_bytes = 1 << 16;  // what lies in it is on neither side
  setsockopt(server, SOL_SOCKET, SO_RCVBUF, &buffer_bytes, sizeof(buffer_bytes));
  const sockaddr_in address = loopback(server_port);
  connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  Lane to_server(client, server, to_server_);
  Lane to_client(server, client, to_client_);
  while (!cut_) {
    std::array<pollfd, 2> ends{to_server.awaited(), to_client.awaited()};
    if (poll(ends.data(), ends.size(), 10) <= 0) continue;
    if (ends[0].revents != 0 && to_server.pass() == 0) break;
    if (ends[1].revents == 0) continue;
    const size_t passed = to_client.pass();
    if (passed == 0) break;
    bytes_to_client_ += passed;
  }
  reset(client);
  reset(server);
}

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

Film make_film(size_t frames, uint32_t width, uint32_t height) {
  auto film = std::make_shared<std::vector<WireFrame>>();
  for (size_t i = 0; i < frames; ++i) {
    const auto number = static_cast<uint32_t>(i);
    const float light = std::exp2(4 * std::sin(0.7f * static_cast<float>(i)));
    film->push_back(make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
      return {light * noise(x, y, 3 * number), light * noise(x, y, 3 * number + 1),
              light * noise(x, y, 3 * number + 2), 1};
    }));
  }
  return film;
}

SessionFrame frame_of(const Film& film, size_t i) {
  const WireFrame& frame = film->at(i);
  return {.width = frame.desc.width,
          .height = frame.desc.height,
          .format = wire_format(frame.desc.format),
          .pixels = frame.pixels,
          .owner = film,
          .sequence = i,
          .media_time_ns = film_time_ns(i)};
}

SessionRun run_frames(absl::StatusOr<Session> session, size_t first, size_t last,
                      const std::function<SessionFrame(size_t)>& frame,
                      const std::function<void(size_t)>& on_result) {
  SessionRun run;
  run.status = session.status();
  if (!session.ok()) return run;
  std::thread feeder([&] {
    for (size_t i = first; i < last; ++i) {
      if (!session->submit(frame(i)).ok()) return;
    }
    session->finish();
  });
  while (true) {
    const absl::StatusOr<std::optional<FrameResult>> result = session->next_result();
    run.status = result.status();
    if (!result.ok() || !*result) break;
    const FrameResult& shown = **result;
    EXPECT_EQ(shown.sequence, first + run.images.size());
    EXPECT_OK(shown.status);
    run.images.emplace_back(reinterpret_cast<const char*>(shown.image.data.get()), shown.image.bytes);
    run.headers.push_back(shown.image.header);
    if (on_result) on_result(run.images.size());
  }
  feeder.join();
  run.stats = session->stats();
  return run;
}

SessionRun run_session(absl::StatusOr<Session> session, const Film& film,
                       const std::function<void(size_t)>& on_result) {
  const auto frame = [&film](size_t i) { return frame_of(film, i); };
  return run_frames(std::move(session), 0, film->size(), frame, on_result);
}

double quantile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values.at(static_cast<size_t>(part * static_cast<double>(values.size() - 1)));
}

Repeated::Repeated(std::function<void()> call)
    : call_(std::move(call)), thread_([this] {
        while (!stop_ && !::testing::Test::HasFailure()) call_();
      }) {}

Repeated::~Repeated() {
  stop_ = true;
  thread_.join();
}

Bystander::Bystander(const std::string& address, WireFrame frame, absl::Time deadline)
    : frame_(std::move(frame)), client_(own_channel(address), true, deadline) {
  EXPECT_TRUE(client_.open("bystander"));
}

double Bystander::latency_ms() {
  const absl::Time begin = absl::Now();
  StreamResult result;
  client_.send(frame_, answered_, static_cast<int64_t>(answered_));
  EXPECT_TRUE(client_.read(result) && !result.failed) << "after " << answered_;
  const double ms = absl::ToDoubleMilliseconds(absl::Now() - begin);
  if (answered_++ == 0) first_ = result.pixels;
  EXPECT_TRUE(result.pixels == first_);
  return ms;
}

std::vector<double> Bystander::latencies_ms(int frames, absl::Duration pause) {
  std::vector<double> all;
  for (int i = 0; i < frames; ++i) {
    all.push_back(latency_ms());
    absl::SleepFor(pause);
  }
  return all;
}

Load::Load(const std::string& address, const std::string& session, WireFrame frame)
    : frame_(std::move(frame)), client_(own_channel(address)) {
  EXPECT_TRUE(client_.open(session));
  sender_ = std::thread([this] {
    for (uint64_t i = 0; !stop_ && client_.send(frame_, i, static_cast<int64_t>(i)); ++i) {
    }
    client_.half_close();
  });
  receiver_ = std::thread([this] {
    StreamResult result;
    while (client_.read(result)) {
      for (const v1::StageTime& stage : result.header.stages()) {
        if (measuring_ && stage.name() != "queue") device_ns_ += stage.ns();
      }
      ++answered_;
    }
  });
}

void Load::stop() {
  stop_ = true;
  if (sender_.joinable()) sender_.join();
  if (receiver_.joinable()) receiver_.join();
}

}  // namespace candela::testing
