// Memory that clients share with a server, and the socket at which they register it.
#include "client/call/shared_memory.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/base/listening_socket.h"
#include "server/session/client_memory.h"
#include "server/session/memory_door.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/clock.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// A connection to `path`; not open if nobody listens there. Closes it at the end.
class MemoryClient {
 public:
  explicit MemoryClient(const std::string& path);
  ~MemoryClient();
  MemoryClient(const MemoryClient&) = delete;
  MemoryClient& operator=(const MemoryClient&) = delete;

  // Sends these bytes with these descriptors. Returns whether it could.
  bool send(const std::string& bytes, const std::vector<int>& descriptors);
  // Waits for the answer; "" if the server closed.
  std::string answer();
  // Waits until the server has closed.
  bool closed() { return answer().empty(); }
  void close();

 private:
  int socket_ = -1;
};

// A memfd of `bytes`, with these seals. The caller closes it.
int make_memfd(uint64_t bytes, int seals, unsigned flags = 0) {
  const int descriptor = memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING | flags);
  if (descriptor >= 0 && ftruncate(descriptor, static_cast<off_t>(bytes)) == 0) {
    fcntl(descriptor, F_ADD_SEALS, seals);
  }
  return descriptor;
}

int all_seals() { return F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL; }

MemoryClient::MemoryClient(const std::string& path)
    : socket_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, path.data(), path.size());
  if (connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) close();
}

MemoryClient::~MemoryClient() { close(); }

void MemoryClient::close() {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

bool MemoryClient::send(const std::string& bytes, const std::vector<int>& descriptors) {
  std::string data = bytes;
  iovec part{data.data(), data.size()};
  std::vector<char> control(CMSG_SPACE(descriptors.size() * sizeof(int)));
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  if (!descriptors.empty()) {
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    cmsghdr* const header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(descriptors.size() * sizeof(int));
    std::memcpy(CMSG_DATA(header), descriptors.data(), descriptors.size() * sizeof(int));
  }
  return sendmsg(socket_, &message, MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
}

std::string MemoryClient::answer() {
  std::string bytes(300, '\0');
  const ssize_t size = recv(socket_, bytes.data(), bytes.size(), 0);
  bytes.resize(size > 0 ? static_cast<size_t>(size) : 0);
  return bytes;
}

// What this process has: its descriptors, and its mappings of memfds.
size_t open_descriptors() {
  const std::filesystem::directory_iterator all("/proc/self/fd");
  return static_cast<size_t>(std::distance(begin(all), end(all)));
}

size_t memfds_mapped() {
  std::ifstream maps("/proc/self/maps");
  size_t count = 0;
  for (std::string line; std::getline(maps, line);) {
    if (line.find("/memfd:test") != std::string::npos || line.find("/memfd:candela") != std::string::npos)
      ++count;
  }
  return count;
}

// Frames and images that pass through shared memory.

class SharedFrames : public ::testing::Test {
 protected:
  SharedFrames() {
    Config config = test_config();
    config.listen = {"unix:" + path_, "127.0.0.1:0"};
    config.memory_budget_bytes = uint64_t{1} << 30;
    server_ = start_server(config);
  }

  SessionOptions options(Transport transport) const {
    SessionOptions options;
    options.servers = {"unix:" + path_};
    options.transport = transport;
    return options;
  }
  SessionRun run(const SessionOptions& options, const Film& film) const {
    return run_session(Session::open(options), film);
  }
  // The same by both ways.
  void expect_same_bits(SessionOptions asked, const Film& film) const {
    asked.transport = Transport::kGrpc;
    const SessionRun bands = run(asked, film);
    asked.transport = Transport::kMemory;
    const SessionRun memory = run(asked, film);
    ASSERT_OK(bands.status);
    ASSERT_OK(memory.status);
    EXPECT_FALSE(bands.stats.shares_memory);
    EXPECT_TRUE(memory.stats.shares_memory);
    ASSERT_EQ(memory.images.size(), film->size());
    EXPECT_TRUE(bands.images == memory.images);
    EXPECT_EQ(bands.exposures(), memory.exposures());
    const bool raw = asked.encoding == v1::ENCODING_RAW;
    for (const v1::ResultHeader& header : bands.headers) EXPECT_FALSE(header.image_in_memory());
    for (const v1::ResultHeader& header : memory.headers) EXPECT_EQ(header.image_in_memory(), raw);
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.path("s");
  std::unique_ptr<Server> server_;
};

Film film_of(uint32_t width, uint32_t height, v1::PixelFormat format) {
  auto film = std::make_shared<std::vector<WireFrame>>();
  for (uint32_t i = 0; i < 7; ++i) film->push_back(natural(width + i % 2, height, format));
  return film;
}

TEST_F(SharedFrames, ImagesAreTheSameBitsForEverySizeAndFormat) {
  constexpr v1::PixelFormat kFormats[] = {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F,
                                          v1::PIXEL_FORMAT_RGB9E5};
  constexpr v1::OutputFormat kOutputs[] = {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16,
                                           v1::OUTPUT_FORMAT_RGBA16F};
  constexpr Size kSizes[] = {{1, 1}, {2, 7}, {63, 65}, {129, 64}, {333, 201}};
  for (const Size size : kSizes) {
    for (size_t i = 0; i < 3; ++i) {
      SCOPED_TRACE(std::to_string(size.width) + " " + std::to_string(i));
      SessionOptions asked = options(Transport::kAuto);
      asked.settings.set_output_format(kOutputs[i]);
      expect_same_bits(asked, film_of(size.width, size.height, kFormats[i]));
    }
  }
}

TEST_F(SharedFrames, ResizedLookedAheadDitheredAndVerifiedTiersAreTheSameBitsToo) {
  const Film film = make_film(8, 170, 90);
  SessionOptions asked = options(Transport::kAuto);
  asked.settings.mutable_output_size()->set_width(77);
  expect_same_bits(asked, film);
  asked = options(Transport::kAuto);
  asked.lookahead = 3;
  asked.settings.set_dither(true);
  expect_same_bits(asked, film);
  asked = options(Transport::kAuto);
  asked.settings.set_tier("reference");
  expect_same_bits(asked, film);
  asked = options(Transport::kAuto);
  asked.settings.set_max_error_codes(0.5);
  expect_same_bits(asked, film);
}

TEST_F(SharedFrames, FilesComeAsPartsAndAreTheSameBits) {
  const Film film = make_film(4, 170, 90);
  for (const v1::Encoding encoding : {v1::ENCODING_PNG, v1::ENCODING_JPEG}) {
    SessionOptions asked = options(Transport::kAuto);
    asked.encoding = encoding;
    expect_same_bits(asked, film);
  }
}

TEST_F(SharedFrames, BadValuesFailTheirFrameAloneAndAreFoundInMemory) {
  SessionOptions asked = options(Transport::kMemory);
  asked.settings.set_bad_values(v1::BAD_VALUES_REJECT);
  absl::StatusOr<Session> session = Session::open(asked);
  ASSERT_OK(session.status());
  WireFrame bad = natural(64, 64);
  std::fill(bad.pixels.begin() + 800, bad.pixels.begin() + 808, std::byte{0xff});
  const Film film =
      std::make_shared<std::vector<WireFrame>>(std::vector<WireFrame>{natural(64, 64), bad, natural(64, 64)});
  for (size_t i = 0; i < 3; ++i) ASSERT_OK(session->submit(frame_of(film, i)));
  session->finish();
  for (size_t i = 0; i < 3; ++i) {
    const auto result = session->next_result();
    ASSERT_OK(result.status());
    EXPECT_EQ((*result)->status.ok(), i != 1) << i;
  }
}

TEST_F(SharedFrames, AnAreaOfTheSessionIsSentWithoutACopyAndAResultLivesOnItsOwn) {
  const Film film = make_film(6, 100, 50);
  const SessionRun expected = run(options(Transport::kGrpc), film);
  FrameResult kept;
  {
    absl::StatusOr<Session> session = Session::open(options(Transport::kMemory));
    ASSERT_OK(session.status());
    for (size_t i = 0; i < film->size(); ++i) {
      const FrameArea area = session->area(100, 50, v1::PIXEL_FORMAT_RGBA16F);
      ASSERT_EQ(area.pixels.size(), film->at(i).pixels.size());
      std::memcpy(area.pixels.data(), film->at(i).pixels.data(), area.pixels.size());
      SessionFrame frame = frame_of(film, i);
      frame.pixels = area.pixels;
      frame.owner = area.owner;
      ASSERT_OK(session->submit(std::move(frame)));
      auto result = session->next_result();
      ASSERT_OK(result.status());
      ASSERT_OK((*result)->status);
      EXPECT_TRUE((*result)->image.header.image_in_memory());
      const auto pixels = (*result)->image.pixels();
      EXPECT_TRUE(std::string(reinterpret_cast<const char*>(pixels.data()), pixels.size()) ==
                  expected.images.at(i));
      if (i == 2) kept = std::move(**result);
    }
  }
  const auto pixels = kept.image.pixels();
  EXPECT_TRUE(std::string(reinterpret_cast<const char*>(pixels.data()), pixels.size()) ==
              expected.images.at(2));
}

// Its first row lies where the protocol lets no frame begin.
TEST_F(SharedFrames, ACropOfAnAreaIsTheSameBits) {
  const WireFrame whole = natural(101, 51);
  WireFrame crop = whole;
  crop.pixels.erase(crop.pixels.begin(), crop.pixels.begin() + 101 * 8);
  crop.desc.height = 50;
  const SessionRun expected =
      run(options(Transport::kGrpc), std::make_shared<std::vector<WireFrame>>(1, crop));
  absl::StatusOr<Session> session = Session::open(options(Transport::kMemory));
  ASSERT_OK(session.status());
  const FrameArea area = session->area(101, 51, v1::PIXEL_FORMAT_RGBA16F);
  std::memcpy(area.pixels.data(), whole.pixels.data(), area.pixels.size());
  ASSERT_OK(session->submit(
      {.width = 101, .height = 50, .pixels = area.pixels.subspan(101 * 8), .owner = area.owner}));
  const auto result = session->next_result();
  ASSERT_OK(result.status());
  ASSERT_OK((*result)->status);
  const auto pixels = (*result)->image.pixels();
  EXPECT_TRUE(std::string(reinterpret_cast<const char*>(pixels.data()), pixels.size()) ==
              expected.images.at(0));
}

TEST_F(SharedFrames, ResultsThatAreKeptLeaveTheNextOnesToBands) {
  const Film film = make_film(20, 64, 64);
  absl::StatusOr<Session> session = Session::open(options(Transport::kMemory));
  ASSERT_OK(session.status());
  std::vector<FrameResult> kept;
  for (size_t i = 0; i < film->size(); ++i) {
    ASSERT_OK(session->submit(frame_of(film, i)));
    auto result = session->next_result();
    ASSERT_OK(result.status());
    ASSERT_OK((*result)->status);
    kept.push_back(std::move(**result));
  }
  EXPECT_TRUE(kept.front().image.header.image_in_memory());
  EXPECT_FALSE(kept.back().image.header.image_in_memory());
  const SessionRun expected = run(options(Transport::kGrpc), film);
  for (size_t i = 0; i < film->size(); ++i) {
    const auto pixels = kept[i].image.pixels();
    EXPECT_TRUE(std::string(reinterpret_cast<const char*>(pixels.data()), pixels.size()) ==
                expected.images.at(i));
  }
}

TEST_F(SharedFrames, OnlyAUnixSocketOffersIt) {
  for (const std::string& address : server_->addresses()) {
    const absl::StatusOr<Connection> connection = Connection::open(address);
    const absl::StatusOr<v1::GetServerInfoResponse> info = connection->server_info();
    ASSERT_OK(info.status());
    EXPECT_EQ(info->shared_memory(), address.starts_with("unix:")) << address;
  }
  SessionOptions asked = options(Transport::kMemory);
  asked.servers = {server_->addresses().back()};
  EXPECT_REFUSED(kInvalidArgument, "unix:PATH", Session::open(asked).status());
}

// One Stream call whose first header is `header`, through `address`.
grpc::Status answer_to(const std::string& address, const v1::FrameHeader& header) {
  grpc::ClientContext context;
  if (header.media_time_ns() == 1) context.AddMetadata("x-forwarded-for", "10.0.0.1");
  const auto stub = v1::RenderService::NewStub(own_channel(address));
  const auto stream = stub->Stream(&context);
  v1::StreamRequest request;
  *request.mutable_open() = open_of("session");
  stream->Write(request);
  *request.mutable_frame() = header;
  stream->Write(request);
  stream->WritesDone();
  v1::StreamResponse response;
  while (stream->Read(&response)) {
  }
  return stream->Finish();
}

TEST_F(SharedFrames, LyingOffsetsAndTicketsAreRefused) {
  const auto region = SharedRegion::create(path_, 1 << 20);
  ASSERT_OK(region.status());
  v1::FrameHeader good;
  good.set_width(64);
  good.set_height(64);
  good.set_format(v1::PIXEL_FORMAT_RGBA16F);
  good.mutable_memory()->set_ticket((*region)->ticket());
  good.mutable_memory()->set_pixels_offset(0);
  good.mutable_memory()->set_image_offset(1 << 19);
  const std::string address = "unix:" + path_;
  EXPECT_TRUE(answer_to(address, good).ok()) << answer_to(address, good).error_message();
  constexpr uint64_t kMost = std::numeric_limits<uint64_t>::max();
  constexpr uint64_t kPixels = 64 * 64 * 8;
  for (const uint64_t offset :
       {uint64_t{1}, uint64_t{8}, uint64_t{(1 << 20) - kPixels + 64}, uint64_t{1} << 20, uint64_t{1} << 32,
        uint64_t{1} << 63, kMost, kMost - 63, kMost - kPixels + 1}) {
    v1::FrameHeader bad = good;
    bad.mutable_memory()->set_pixels_offset(offset);
    EXPECT_REFUSED(kInvalidArgument, "frame.memory.pixels_offset", answer_to(address, bad));
    bad = good;
    bad.mutable_memory()->set_image_offset(offset == uint64_t{(1 << 20) - kPixels + 64} ? kMost - 127
                                                                                        : offset);
    EXPECT_REFUSED(kInvalidArgument, "frame.memory.image_offset", answer_to(address, bad));
  }
  v1::FrameHeader padded = good;  // the last row ends beyond the region
  padded.set_row_stride_bytes(64 * 8 + 4096);
  padded.mutable_memory()->set_pixels_offset((1 << 20) - 64 * (64 * 8 + 4096) + 4096 - 4096 % 64 + 64);
  EXPECT_REFUSED(kInvalidArgument, "frame.memory.pixels_offset", answer_to(address, padded));
  v1::FrameHeader other = good;
  other.mutable_memory()->set_ticket(std::string(16, 'x'));
  EXPECT_REFUSED(kUnavailable, "frame.memory.ticket", answer_to(address, other));
  other.mutable_memory()->set_ticket("short");
  EXPECT_REFUSED(kInvalidArgument, "frame.memory.ticket", answer_to(address, other));
  // The same ticket through a proxy, and over TCP.
  v1::FrameHeader through = good;
  through.set_media_time_ns(1);
  EXPECT_REFUSED(kUnavailable, "unix socket", answer_to(address, through));
  EXPECT_REFUSED(kUnavailable, "unix socket", answer_to(server_->addresses().back(), good));
}

// Padded rows reach as far as the last row's pixels, and the padding is not looked at. A verification reads
// the image again, and its error map comes in bands.
TEST_F(SharedFrames, SingleCallsTakePaddedRowsAndAreTheSameBitsVerifiedToo) {
  const WireFrame frame = natural(65, 33);
  const auto region = SharedRegion::create(path_, 1 << 20);
  ASSERT_OK(region.status());
  const SharedRegion::Area area = (*region)->take((*region)->bytes());
  std::byte* const image = area.bytes.get() + (1 << 19);
  const uint64_t row = 65 * 8, stride = row + 100;
  for (const bool verify : {false, true}) {
    std::memset(area.bytes.get(), 0xff, area.size);
    for (uint64_t y = 0; y < 33; ++y) {
      std::memcpy(area.bytes.get() + y * stride, frame.pixels.data() + y * row, row);
    }
    v1::RenderRequest start = start_of(frame);
    start.mutable_start()->set_verify(verify);
    start.mutable_start()->set_error_map(verify);
    v1::FrameHeader& header = *start.mutable_start()->mutable_frame();
    header.clear_total_bytes();
    header.set_row_stride_bytes(static_cast<uint32_t>(stride));
    header.mutable_memory()->set_ticket((*region)->ticket());
    header.mutable_memory()->set_pixels_offset(0);
    header.mutable_memory()->set_image_offset(1 << 19);
    OpenCall call(own_channel("unix:" + path_));
    call.write(start);
    call.stream->WritesDone();
    v1::RenderResponse response;
    ASSERT_TRUE(call.stream->Read(&response));
    EXPECT_TRUE(response.header().image_in_memory());
    EXPECT_EQ(response.header().has_verify(), verify);
    EXPECT_EQ(call.stream->Read(&response), verify);
    EXPECT_EQ(response.has_error_map(), verify);
    const grpc::Status status = call.finish();
    ASSERT_TRUE(status.ok()) << status.error_message();
    const absl::StatusOr<RenderResult> expected = Connection::open("unix:" + path_)->render({}, view(frame));
    ASSERT_OK(expected.status());
    EXPECT_EQ(std::memcmp(image, expected->data.get(), expected->bytes), 0);
    // Nothing beyond the image was written.
    EXPECT_EQ(image[expected->bytes], std::byte{0xff});
  }
}

// Its own frames come, with any bits, and another client's are right.
TEST_F(SharedFrames, AClientThatWritesIntoItsFramesHarmsItselfAlone) {
  const Film film = make_film(30, 320, 240);
  const SessionRun expected = run(options(Transport::kGrpc), film);
  ASSERT_OK(expected.status);
  constexpr uint64_t kRegion = 4 << 20;
  const int memfd = make_memfd(kRegion, all_seals());
  auto* const bytes =
      static_cast<std::byte*>(mmap(nullptr, kRegion, PROT_READ | PROT_WRITE, MAP_SHARED, memfd, 0));
  MemoryClient door(path_ + ".memory");
  ASSERT_TRUE(door.send(std::string(1, '\1'), {memfd}));
  const std::string answer = door.answer();
  ASSERT_EQ(answer.size(), 17u);
  std::atomic<bool> stop = false;
  std::thread writer([&] {
    std::mt19937 random(1);
    while (!stop) {
      const uint64_t at = random() % (kRegion - 65536);
      if (random() % 16 == 0) {
        fallocate(memfd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(at), 65536);
      } else {
        for (uint64_t i = 0; i < 65536; ++i) bytes[at + i] = static_cast<std::byte>(random());
      }
    }
  });
  std::thread attacker([&] {
    for (int i = 0; i < 40; ++i) {
      v1::FrameHeader header;
      header.set_width(320);
      header.set_height(240);
      header.set_format(v1::PIXEL_FORMAT_RGBA16F);
      header.mutable_memory()->set_ticket(answer.substr(1));
      header.mutable_memory()->set_pixels_offset(0);
      header.mutable_memory()->set_image_offset(i % 2 == 0 ? 0 : 1 << 20);  // over its own pixels, too
      const grpc::Status status = answer_to("unix:" + path_, header);
      EXPECT_TRUE(status.ok() || status.error_code() == grpc::ALREADY_EXISTS) << status.error_message();
    }
  });
  const SessionRun beside = run(options(Transport::kMemory), film);
  attacker.join();
  stop = true;
  writer.join();
  munmap(bytes, kRegion);
  close(memfd);
  ASSERT_OK(beside.status);
  EXPECT_TRUE(beside.images == expected.images);
}

TEST_F(SharedFrames, NothingIsLeftOfSessionsThatEndedInAnyWay) {
  const Film film = make_film(4, 200, 100);
  ASSERT_OK(run(options(Transport::kMemory), film).status);
  const absl::StatusOr<Connection> connection = Connection::open("unix:" + path_);
  ASSERT_TRUE(wait_until_idle(*connection));
  for (int i = 0; i < 8; ++i) {
    absl::StatusOr<Session> session = Session::open(options(Transport::kMemory));
    ASSERT_OK(session.status());
    for (size_t k = 0; k < 1 + static_cast<size_t>(i) % 3; ++k) ASSERT_OK(session->submit(frame_of(film, k)));
    if (i % 2 == 0) session->cancel();
  }
  ASSERT_TRUE(wait_until_idle(*connection));
  server_.reset();
  EXPECT_EQ(memfds_mapped(), 0u);
  EXPECT_TRUE(folder_.list().empty());
}

// Look-ahead holds the results back, so the server is lost before the first one. It did not refuse the
// memory.
TEST(SharedFramesResume, AServerThatIsKilledBeforeTheFirstResultStillSharesMemoryThen) {
  const TemporaryFolder folder;
  const std::vector<std::string> arguments = {"--listen", "unix:" + folder.path("s")};
  const Film film = make_film(8, 160, 90);
  auto daemon = std::make_unique<Daemon>(arguments);
  ASSERT_NE(daemon->wait_until_listening(), "") << daemon->errors();
  SessionOptions options;
  options.servers = {"unix:" + folder.path("s")};
  options.lookahead = 4;
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options));
  for (size_t i = 0; i < film->size(); ++i) {
    if (i == 3) {
      absl::SleepFor(absl::Milliseconds(100));  // the frames before are on their way
      daemon->signal(SIGKILL);
      daemon->wait();
      daemon = std::make_unique<Daemon>(arguments);
      ASSERT_NE(daemon->wait_until_listening(), "");
    }
    ASSERT_OK(session.submit(frame_of(film, i)));
  }
  session.finish();
  bool in_memory = false;
  for (;;) {
    ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.next_result());
    if (!result) break;
    ASSERT_OK(result->status);
    in_memory = result->image.header.image_in_memory();
  }
  EXPECT_TRUE(in_memory);
  EXPECT_EQ(session.stats().resumes, 1u);
}

TEST(SharedFramesResume, AServerThatIsKilledAndStartedAgainGivesTheSameBits) {
  const TemporaryFolder folder;
  const TemporaryFile keys("0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef\n");
  const std::vector<std::string> arguments = {"--listen", "unix:" + folder.path("s"), "--resume-keys",
                                              keys.path()};
  const Film film = make_film(24, 160, 90);
  auto daemon = std::make_unique<Daemon>(arguments);
  ASSERT_NE(daemon->wait_until_listening(), "") << daemon->errors();
  SessionOptions options;
  options.servers = {"unix:" + folder.path("s")};
  options.transport = Transport::kGrpc;
  const SessionRun expected = run_session(Session::open(options), film);
  ASSERT_OK(expected.status);
  options.transport = Transport::kMemory;
  const SessionRun run = run_session(Session::open(options), film, [&](size_t results) {
    if (results != 5 && results != 14) return;
    daemon->signal(SIGKILL);
    daemon->wait();
    daemon = std::make_unique<Daemon>(arguments);
    EXPECT_NE(daemon->wait_until_listening(), "");
  });
  ASSERT_OK(run.status);
  EXPECT_GE(run.stats.resumes, 2u);
  EXPECT_TRUE(run.images == expected.images);
  EXPECT_TRUE(run.headers.back().image_in_memory());
  daemon->signal(SIGTERM);
  EXPECT_EQ(daemon->wait(), 0);
  EXPECT_TRUE(folder.list().empty());
}

// Clients of the `.memory` socket that do not keep to docs/transport.md, in virtual time.

constexpr uint64_t kBudget = uint64_t{64} << 20;
constexpr uint64_t kBytes = 1 << 20;
const std::string kHello(1, '\1');

class MemorySocket : public ::testing::Test {
 protected:
  MemorySocket() {
    auto sockets = ListeningSocket::listen("listen", "unix:" + path_);
    EXPECT_OK(sockets.status());
    listening_ = std::make_unique<ListeningSocket>(std::move(sockets->front()));
    door_ = std::make_unique<MemoryDoor>(
        regions_, clock_, MemoryDoor::Options{.max_connections = 3, .hello_limit = absl::Seconds(5)},
        [memory = memory_](uint64_t bytes) { return memory->claim_region(7, bytes); });
  }

  // A client whose connection the door has.
  std::unique_ptr<MemoryClient> client() {
    auto client = std::make_unique<MemoryClient>(path_);
    const int flags = fcntl(listening_->descriptor(), F_GETFL);
    fcntl(listening_->descriptor(), F_SETFL, flags & ~O_NONBLOCK);
    door_->take(accept4(listening_->descriptor(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    return client;
  }
  // The server's answer to one message.
  std::string answer_to(const std::string& bytes, const std::vector<int>& descriptors) {
    const auto asking = client();
    EXPECT_TRUE(asking->send(bytes, descriptors));
    std::string answer = asking->answer();
    if (!answer.empty() && answer.front() != 0) {
      EXPECT_TRUE(asking->closed());
    }
    return answer;
  }
  void expect_refused(int descriptor, const char* words) {
    ASSERT_GE(descriptor, 0);
    const std::string answer = answer_to(kHello, {descriptor});
    close(descriptor);
    ASSERT_GT(answer.size(), 1u);
    EXPECT_NE(answer.find(words), std::string::npos) << answer.substr(1);
    EXPECT_EQ(regions_.count(), 0u);
    EXPECT_EQ(memory_->frames_bytes(), 0u);
  }
  void wait_for_connections(size_t count) {
    while (door_->connections() != count) usleep(100);  // its own thread sees the end
  }

  const TemporaryFolder folder_;
  const std::string path_ = folder_.path("s.memory");
  const std::shared_ptr<ClientMemory> memory_ =
      std::make_shared<ClientMemory>(kBudget, 50, absl::Seconds(10));
  VirtualClock clock_;
  MemoryRegions regions_;
  std::unique_ptr<ListeningSocket> listening_;
  std::unique_ptr<MemoryDoor> door_;
};

TEST_F(MemorySocket, ARegionLivesAsLongAsItsConnection) {
  const size_t before = memfds_mapped();
  auto one = client();
  const int descriptor = make_memfd(kBytes, all_seals());
  ASSERT_TRUE(one->send(kHello, {descriptor}));
  close(descriptor);
  const std::string answer = one->answer();
  ASSERT_EQ(answer.size(), 17u);
  const std::string ticket = answer.substr(1);
  EXPECT_EQ(memory_->frames_bytes(), kBytes);
  {
    const auto region = regions_.find(ticket);
    ASSERT_OK(region.status());
    EXPECT_EQ((*region)->bytes(), kBytes);
    one->close();
    wait_for_connections(0);
    EXPECT_REFUSED(kUnavailable, "frame.memory.ticket", regions_.find(ticket).status());
    // Whoever uses it still can.
    (*region)->data()[kBytes - 1] = std::byte{1};
    EXPECT_EQ(memory_->frames_bytes(), kBytes);
  }
  EXPECT_EQ(memory_->frames_bytes(), 0u);
  EXPECT_EQ(memfds_mapped(), before);
}

TEST_F(MemorySocket, WrongDescriptorsAreRefused) {
  int pipes[2];
  ASSERT_EQ(pipe2(pipes, O_CLOEXEC), 0);
  expect_refused(pipes[0], "no memfd");
  close(pipes[1]);
  expect_refused(open("/tmp", O_RDONLY | O_DIRECTORY | O_CLOEXEC), "no memfd");
  expect_refused(open("/proc/self/exe", O_RDONLY | O_CLOEXEC), "no memfd");
  expect_refused(make_memfd(kBytes, 0), "seals");
  expect_refused(make_memfd(kBytes, F_SEAL_SHRINK | F_SEAL_GROW), "seals");
  expect_refused(make_memfd(kBytes, all_seals() | F_SEAL_WRITE), "F_SEAL_WRITE");
  expect_refused(make_memfd(0, all_seals()), "0 bytes");
  expect_refused(make_memfd(uint64_t{1} << 40, all_seals()), "must have 1 to");
  expect_refused(make_memfd(kBudget / 2, all_seals()), "a quarter of this");
  // Without pages of that kind it cannot have a size, and is refused for that.
  if (const int huge = make_memfd(uint64_t{2} << 20, all_seals(), MFD_HUGETLB); huge >= 0) {
    expect_refused(huge, "region");
  }
}

TEST_F(MemorySocket, WrongMessagesAreRefusedAndKeepNoDescriptor) {
  const int good = make_memfd(kBytes, all_seals());
  const size_t before = open_descriptors();
  for (const auto& [bytes, descriptors] :
       std::vector<std::pair<std::string, std::vector<int>>>{{kHello, {}},
                                                             {"\2", {good}},
                                                             {"\1\1", {good}},
                                                             {std::string(100, '\1'), {good}},
                                                             {kHello, {good, good}},
                                                             {kHello, std::vector<int>(200, good)}}) {
    const std::string answer = answer_to(bytes, descriptors);
    ASSERT_FALSE(answer.empty());
    EXPECT_EQ(answer.front(), 3) << answer;
    EXPECT_EQ(regions_.count(), 0u);
  }
  wait_for_connections(0);
  EXPECT_EQ(open_descriptors(), before);
  close(good);
}

TEST_F(MemorySocket, AClientThatSendsMoreIsClosed) {
  auto one = client();
  const int descriptor = make_memfd(kBytes, all_seals());
  ASSERT_TRUE(one->send(kHello, {descriptor}));
  ASSERT_EQ(one->answer().size(), 17u);
  one->send(kHello, {descriptor});
  close(descriptor);
  EXPECT_TRUE(one->closed());
  wait_for_connections(0);
  EXPECT_EQ(regions_.count(), 0u);
}

TEST_F(MemorySocket, AClientThatIsSilentIsClosedAtItsLimit) {
  auto silent = client();
  auto good = client();
  const int descriptor = make_memfd(kBytes, all_seals());
  clock_.wait_for_timers(2);
  ASSERT_TRUE(good->send(kHello, {descriptor}));
  ASSERT_EQ(good->answer().size(), 17u);
  close(descriptor);
  clock_.advance(absl::Milliseconds(4999));
  EXPECT_EQ(door_->connections(), 2u);
  clock_.advance(absl::Milliseconds(1));
  EXPECT_TRUE(silent->closed());
  wait_for_connections(1);
  EXPECT_EQ(regions_.count(), 1u);
}

TEST_F(MemorySocket, BeyondItsLimitConnectionsAreClosedAndTheOthersStay) {
  std::vector<std::unique_ptr<MemoryClient>> clients;
  for (int i = 0; i < 3; ++i) clients.push_back(client());
  for (int i = 0; i < 1000; ++i) {
    const auto beyond = client();
    EXPECT_EQ(beyond->answer().front(), 14);
  }
  const int descriptor = make_memfd(kBytes, all_seals());
  ASSERT_TRUE(clients.front()->send(kHello, {descriptor}));
  EXPECT_EQ(clients.front()->answer().size(), 17u);
  close(descriptor);
}

TEST_F(MemorySocket, RegionsTakeAQuarterOfTheBudgetTogether) {
  std::vector<std::unique_ptr<MemoryClient>> clients;
  std::vector<char> answers;
  for (int i = 0; i < 3; ++i) {
    clients.push_back(client());
    const int descriptor = make_memfd(kBudget / 8, all_seals());
    ASSERT_TRUE(clients.back()->send(kHello, {descriptor}));
    close(descriptor);
    answers.push_back(clients.back()->answer().front());
  }
  EXPECT_EQ(answers, (std::vector<char>{0, 0, 14}));
  EXPECT_EQ(memory_->frames_bytes(), kBudget / 4);
}

TEST_F(MemorySocket, ItsEndClosesEveryConnection) {
  const size_t before = memfds_mapped();
  auto silent = client();
  auto good = client();
  const int descriptor = make_memfd(kBytes, all_seals());
  ASSERT_TRUE(good->send(kHello, {descriptor}));
  ASSERT_EQ(good->answer().size(), 17u);
  close(descriptor);
  door_.reset();
  EXPECT_TRUE(silent->closed());
  EXPECT_TRUE(good->closed());
  EXPECT_EQ(regions_.count(), 0u);
  EXPECT_EQ(memfds_mapped(), before);
}

}  // namespace
}  // namespace candela::testing
