// Frames without a device, through the render loop and a session's exposure, against the model of a session
// that nothing disturbs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <random>
#include <utility>

#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/schedule/render_loop.h"
#include "server/session/session_frames.h"
#include "tests/support/clock.h"
#include "tests/support/settings.h"
#include "tests/support/simulated/frame_maker.h"
#include "tests/support/simulated/undisturbed_run.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using testing::checked;
using testing::SimulatedAnswer;
using testing::SimulatedFrame;
using testing::SimulatedFrameMaker;
using testing::SimulatedScene;
using testing::VirtualClock;

constexpr uint64_t kSimulatedBudget = uint64_t{1} << 20;
constexpr FrameDesc kSmall{3, 3, v1::PIXEL_FORMAT_RGBA16F};

Settings rejecting() {
  v1::Settings message;
  message.set_bad_values(v1::BAD_VALUES_REJECT);
  return checked(message);
}

absl::StatusOr<FrameMemory> memory_of(SimulatedFrameMaker& maker, const SimulatedFrame& frame) {
  absl::StatusOr<FrameMemory> memory = maker.allocate(frame.desc, frame.settings);
  if (!memory.ok()) return memory;
  const uint64_t row_bytes = frame.desc.row_bytes();
  for (uint32_t y = 0; y < frame.desc.height; ++y) {
    std::memcpy(memory->input_row(y).data(), &frame.pixels[y * row_bytes], row_bytes);
  }
  return memory;
}

std::vector<std::byte> image_in(const FrameMemory& memory) {
  std::vector<std::byte> image;
  for (uint32_t y = 0; y < memory.desc().height; ++y) {
    const std::span<const std::byte> row = memory.output_row(y);
    image.insert(image.end(), row.begin(), row.end());
  }
  return image;
}

// What StreamCall does with a session's frames, without the call.
class SimulatedSession {
 public:
  SimulatedSession(RenderLoop& loop, uint32_t lookahead, double cut_threshold_ev)
      : loop_(loop), frames_(lookahead, cut_threshold_ev, {}, 4) {}

  void send(const std::shared_ptr<SimulatedFrameMaker>& maker, const SimulatedFrame& sent) {
    v1::FrameHeader header;
    header.set_sequence(sent.sequence);
    header.set_media_time_ns(sent.media_time_ns);
    header.set_cut(sent.cut);
    if (sent.given) header.set_exposure(*sent.given);
    const auto has_room = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return frames_.has_room(); };
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(&has_room));
    ASSERT_OK(frames_.add(header, {sent.desc, sent.desc.format, sent.desc.row_bytes()},
                          sent.settings->exposure(), "", absl::InfinitePast()));
    const SessionFrames::EntryPtr entry = frames_.newest();
    ASSERT_OK_AND_ASSIGN(FrameMemory memory, memory_of(*maker, sent));
    entry->frame = std::make_shared<Frame>(Frame{maker, std::move(memory), sent.settings, sent.sequence});
    submit(entry, frames_.first_work());
  }

  // Ends the session and the loop; all of the session's answers.
  std::vector<SimulatedAnswer> finish() {
    const auto all_answered = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return frames_.empty(); };
    {
      absl::MutexLock lock(&mutex_);
      frames_.close();
      submit_decided();
      mutex_.Await(absl::Condition(&all_answered));
    }
    loop_.stop();
    return std::move(answers_);
  }

 private:
  void submit(const SessionFrames::EntryPtr& entry, Work work) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    FrameJob job{.frame = entry->frame, .work = work, .flow = 1};
    job.decide = [this, entry, work](const FrameStats& stats) {
      return work == Work::kRender ? frames_.decide(*entry, stats) : entry->exposure.exposed;
    };
    job.done = [this, entry, work](absl::StatusOr<RenderedFrame> rendered) {
      on_worked(entry, work, std::move(rendered));
    };
    const absl::StatusOr<Ticket> ticket = loop_.submit(std::move(job));
    ASSERT_OK(ticket);
    SessionFrames::submitted(*entry, work, *ticket);
  }

  void submit_decided() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    while (const SessionFrames::EntryPtr entry = frames_.next_decided()) submit(entry, Work::kDraw);
  }

  void on_worked(const SessionFrames::EntryPtr& entry, Work work, absl::StatusOr<RenderedFrame> rendered) {
    absl::MutexLock lock(&mutex_);
    if (!rendered.ok()) {
      EXPECT_TRUE(frames_.fail(*entry, rendered.status())) << rendered.status();
    } else if (work == Work::kMeter) {
      frames_.metered(*entry, *std::move(rendered));
    } else {
      SessionFrames::rendered(*entry, *std::move(rendered), /*encode=*/false);
    }
    submit_decided();
    while (const SessionFrames::EntryPtr due = frames_.due()) {
      const Exposed exposed = frames_.answer(*due).exposed;
      const bool done = due->stage == SessionFrames::Stage::kDone;
      EXPECT_TRUE(!done || due->report->exposure == exposed.exposure);
      answers_.push_back(done ? SimulatedAnswer{due->failure, exposed, image_in(due->frame->memory)}
                              : SimulatedAnswer{due->failure, {}, {}});
      frames_.pop();
    }
  }

  RenderLoop& loop_;
  absl::Mutex mutex_;
  SessionFrames frames_;                  // decide() without mutex_
  std::vector<SimulatedAnswer> answers_;  // under mutex_ while the loop runs
};

// Frames of a few scenes, some black, bad or repeated, some that bring their exposure or begin a scene.
std::vector<SimulatedFrame> film(uint64_t seed, size_t count) {
  std::mt19937_64 random(seed);
  const auto one_in = [&random](uint64_t n) { return random() % n == 0; };
  std::vector<SimulatedFrame> frames;
  const Settings settings = rejecting();
  uint64_t scene = random();
  int64_t time_ns = 0;
  while (frames.size() < count) {
    if (one_in(7)) scene = random();
    std::vector<uint64_t> texels(kSmall.bytes() / sizeof(uint64_t));
    if (!one_in(9)) {
      std::generate(texels.begin(), texels.end(), std::ref(random));
      texels[0] = scene;
    }
    if (one_in(9)) texels[5] = ~uint64_t{0};
    const auto bytes = std::as_bytes(std::span(texels));
    SimulatedFrame frame{kSmall, {bytes.begin(), bytes.end()}, settings, frames.size(), time_ns};
    if (one_in(9)) frame.cut = true;
    if (one_in(9)) frame.given = 0.5 + static_cast<double>(random() % 8);
    if (!frames.empty() && one_in(9)) {
      frame.sequence = frames.back().sequence;
      frame.media_time_ns = frames.back().media_time_ns;
      frame.given = std::nullopt;
    }
    frames.push_back(std::move(frame));
    time_ns += static_cast<int64_t>(random() % 100'000'000);
  }
  return frames;
}

TEST(SimulatedMaker, SessionsThroughTheRenderLoopAnswerAsTheModelDoes) {
  for (const uint32_t lookahead : {0, 1, 5}) {
    for (const double cut_threshold_ev : {0.0, 1.0}) {
      for (uint64_t seed = 0; seed < 5; ++seed) {
        SCOPED_TRACE(::testing::Message() << lookahead << ", " << cut_threshold_ev << ", " << seed);
        VirtualClock clock;
        const auto maker = std::make_shared<SimulatedFrameMaker>(kSimulatedBudget, clock);
        const std::vector<SimulatedFrame> frames = film(seed, 60);
        std::vector<SimulatedAnswer> answers;
        {
          RenderLoop loop(run_job, 100, clock);
          SimulatedSession session(loop, lookahead, cut_threshold_ev);
          for (const SimulatedFrame& frame : frames) session.send(maker, frame);
          ASSERT_FALSE(HasFailure());
          answers = session.finish();
        }
        EXPECT_EQ(maker->counters().bytes_in_use, 0u);
        const std::vector<SimulatedAnswer> model =
            testing::undisturbed_run(frames, lookahead, cut_threshold_ev);
        ASSERT_EQ(answers.size(), model.size());
        for (size_t i = 0; i < model.size(); ++i) {
          EXPECT_EQ(answers[i].status, model[i].status) << i;
          EXPECT_EQ(answers[i].exposed.exposure, model[i].exposed.exposure) << i;
          EXPECT_EQ(answers[i].exposed.target, model[i].exposed.target) << i;
          EXPECT_EQ(answers[i].image, model[i].image) << i;
        }
      }
    }
  }
}

TEST(SimulatedMaker, AnImageTellsPixelsSettingsNumberAndExposureApart) {
  SimulatedFrame frame = film(1, 1)[0];
  const auto image = [&](const Settings& settings, uint64_t sequence, double exposure) {
    return SimulatedScene(frame.desc, frame.pixels).image(settings, sequence, exposure);
  };
  const std::vector<std::byte> first = image(frame.settings, 7, 0.5);
  EXPECT_EQ(image(frame.settings, 7, 0.5), first);
  EXPECT_NE(image(checked(testing::at_ev(1)), 7, 0.5), first);
  EXPECT_NE(image(frame.settings, 8, 0.5), first);
  EXPECT_NE(image(frame.settings, 7, std::nextafter(0.5, 1.0)), first);
  frame.pixels.back() ^= std::byte{1};
  EXPECT_NE(image(frame.settings, 7, 0.5), first);
}

TEST(SimulatedMaker, MemoryIsBoundedAsTheRenderersIs) {
  VirtualClock clock;
  SimulatedFrameMaker sizes(kSimulatedBudget, clock);
  ASSERT_OK_AND_ASSIGN(const uint64_t bytes, sizes.bytes_for(kSmall, Settings()));
  SimulatedFrameMaker one(bytes, clock);
  EXPECT_REFUSED(kResourceExhausted, "", one.bytes_for({300, 300, kSmall.format}, Settings()));
  EXPECT_REFUSED(kResourceExhausted, "", one.allocate({300, 300, kSmall.format}, Settings()));
  {
    ASSERT_OK_AND_ASSIGN(const FrameMemory first, one.allocate(kSmall, Settings()));
    EXPECT_EQ(first.bytes(), bytes);
    EXPECT_EQ(one.counters().bytes_in_use, bytes);
    EXPECT_REFUSED(kUnavailable, "", one.allocate(kSmall, Settings()));
  }
  EXPECT_EQ(one.counters().bytes_in_use, 0u);
  EXPECT_OK(one.allocate(kSmall, Settings()));
  EXPECT_GT(one.counters().hits, 0u);
}

TEST(SimulatedMaker, ALostOneFailsEveryFrame) {
  VirtualClock clock;
  SimulatedFrameMaker maker(kSimulatedBudget, clock);
  SimulatedFrame frame = film(1, 1)[0];
  frame.settings = Settings();
  ASSERT_OK_AND_ASSIGN(FrameMemory begun, memory_of(maker, frame));
  ASSERT_OK_AND_ASSIGN(const Metered metered, maker.meter(begun, frame.settings));
  maker.lose();
  EXPECT_REFUSED(kUnavailable, "device lost", maker.draw(begun, frame.settings, 0, metered, {}));
  ASSERT_OK_AND_ASSIGN(FrameMemory next, memory_of(maker, frame));
  EXPECT_REFUSED(kUnavailable, "device lost", maker.render(next, frame.settings));
}

TEST(SimulatedMaker, AViewIsAFrameOfItsEnvironmentAndItsCamera) {
  VirtualClock clock;
  const auto maker = std::make_shared<SimulatedFrameMaker>(kSimulatedBudget, clock);
  Environment environment;
  environment.radiance.emplace()[0][0] = 3.0;
  View view;
  ASSERT_OK(maker->prepare_view(environment, {}, false));
  ASSERT_OK_AND_ASSIGN(FrameMemory memory, maker->allocate(kSmall, Settings()));
  FrameJob job;
  job.frame = std::make_shared<Frame>(Frame{maker, std::move(memory), Settings(), 7});
  job.frame->source = [&](FrameMemory& pixels) { return maker->render_view(environment, view, pixels); };
  job.decide = [](const FrameStats&) { return Exposed{0.5, 1.0}; };
  ASSERT_OK(run_job(job));
  const std::vector<std::byte> pixels = testing::simulated_view(environment, view, kSmall);
  EXPECT_EQ(image_in(job.frame->memory), SimulatedScene(kSmall, pixels).image(Settings(), 7, 0.5));
  view.camera.fov_deg = 61;
  EXPECT_NE(testing::simulated_view(environment, view, kSmall), pixels);
  view.camera.fov_deg = 60;
  environment.radiance->front()[0] = 4.0;
  EXPECT_NE(testing::simulated_view(environment, view, kSmall), pixels);
}

}  // namespace
}  // namespace candela
