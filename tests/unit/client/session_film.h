// A film for a session on servers that a test makes up, and what came of it.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "tests/support/status.h"
#include "tests/unit/client/fake_calls.h"

namespace candela {

inline const grpc::Status kLost{grpc::UNAVAILABLE, "lost"};

inline v1::Settings at_ev(double ev) {
  v1::Settings settings;
  settings.mutable_exposure()->set_manual_ev(ev);
  return settings;
}

inline SessionFrame frame(uint64_t sequence) {
  static const std::vector<std::byte> pixel(8);
  return {.width = 1,
          .height = 1,
          .pixels = pixel,
          .sequence = sequence,
          .media_time_ns = static_cast<int64_t>(sequence) * 1000};
}

inline SessionOptions options() {
  SessionOptions options;
  options.settings = at_ev(1);
  options.resume_limit = absl::Seconds(5);
  options.silence_limit = absl::Minutes(1);
  return options;
}

// google.rpc.Status with a google.rpc.RetryInfo of so many seconds, up to 127.
inline grpc::Status full(int seconds) {
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string info{'\x0a', '\x02', '\x08', static_cast<char>(seconds)};
  const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                          std::string(1, static_cast<char>(info.size())) + info;
  return {grpc::UNAVAILABLE, "full", "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any};
}

struct Outcome {
  absl::Status status = absl::InternalError("it stands still");
  std::vector<int> values;  // a byte of each result, in the order they came
  int events = 0;           // that were passed on
  SessionStats stats;
};

// Submits `frames` frames, with an EV of 2 from frame `change` on, and takes their results. `before` is
// called before each event, with its number.
inline Outcome run(FakeSession& session, uint64_t frames, uint64_t change = 1000,
                   const std::function<void(int event)>& before = nullptr) {
  Outcome run;
  session.driver.start();
  uint64_t next = 0;
  for (bool going = true, finished = false; going;) {
    while (session.state.was_open() && next < frames && session.state.ready()) {
      if (next == change && !session.state.change_settings(next, at_ev(2)).ok()) break;
      if (!session.state.submit(frame(next)).ok()) break;
      ++next;
    }
    if (next == frames && !finished) {
      finished = true;
      session.state.finish();
    }
    if (before) before(run.events);
    going = session.step();
    run.events += going;
    while (session.state.result_ready()) {
      const absl::StatusOr<std::optional<FrameResult>> result = session.state.next_result();
      run.status = result.status();
      if (!result.ok() || !*result) break;
      EXPECT_EQ((**result).sequence, run.values.size());
      run.values.push_back(static_cast<int>((**result).image.pixels().back()));
    }
  }
  run.stats = session.state.stats();
  EXPECT_TRUE(session.driver.ended());
  EXPECT_EQ(session.servers.call_now, nullptr);
  return run;
}

inline std::vector<int> expected(uint64_t frames, uint64_t change = 1000) {
  std::vector<int> values;
  for (uint64_t i = 0; i < frames; ++i) values.push_back(static_cast<int>((i >= change ? 32 : 16) + i));
  return values;
}

}  // namespace candela
