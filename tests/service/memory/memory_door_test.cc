// Clients of the `.memory` socket that do not keep to docs/transport.md, in virtual time.
#include "server/session/memory_door.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/base/listening_socket.h"
#include "server/session/client_memory.h"
#include "tests/service/memory/raw_region.h"
#include "tests/support/clock/virtual_clock.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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
