#include "tests/service/sessions/neighbours.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "absl/time/clock.h"
#include "tests/service/service_fixture.h"

namespace candela::testing {

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
