// Environments on a server: put, looked at, shared and dropped.
#include "server/render/environment/environment.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/session.h"
#include "tests/service/clients.h"
#include "tests/service/environment_fixture.h"
#include "tests/service/service_fixture.h"
#include "tests/support/files.h"
#include "tests/support/settings.h"

namespace candela::testing {
namespace {

TEST_F(EnvironmentService, IsPutOnceAndFoundByTheHashOfItsPixelsUntilItIsDropped) {
  const auto panorama = two_halves();
  ASSERT_OK_AND_ASSIGN(const v1::Environment first, connection().put_environment(*panorama));
  EXPECT_EQ(first.id(), environment_id(*panorama));
  EXPECT_FALSE(first.had_it());
  EXPECT_EQ(first.radiance_sh_size(), 27);
  EXPECT_GT(first.stages_size(), 0);
  EXPECT_EQ(first.default_cube_size(), 16u);
  EXPECT_TRUE(connection().put_environment(*panorama)->had_it());
  EXPECT_EQ(connection().get_environment(first.id())->id(), first.id());
  ASSERT_OK_AND_ASSIGN(const v1::DropEnvironmentResponse dropped, connection().drop_environment(first.id()));
  EXPECT_FALSE(dropped.in_use());
  EXPECT_REFUSED(kNotFound, first.id(), connection().get_environment(first.id()));
  EXPECT_REFUSED(kNotFound, "", connection().drop_environment(first.id()));
}

TEST_F(EnvironmentService, AnIdDependsOnWhatThePixelsMean) {
  const auto panorama = uniform(0.5f);
  Panorama wide = *panorama;
  wide.start.set_input_primaries(v1::PRIMARIES_REC2020);
  Panorama named = *panorama;
  named.start.set_input_primaries(v1::PRIMARIES_REC709);
  Panorama other = *panorama;
  other.start.set_width(32);
  other.start.set_height(64);
  EXPECT_NE(put(wide), put(*panorama));
  EXPECT_EQ(put(named), put(*panorama));
  EXPECT_NE(put(other), put(*panorama));
}

TEST_F(EnvironmentService, AViewOfAUniformPanoramaIsUniformAndRepeatsToTheBit) {
  v1::View view = view_of(put(*uniform(0.5f)), 30);
  v1::Settings linear = plain();
  linear.set_curve(v1::TONE_CURVE_LINEAR);
  linear.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  for (const uint32_t samples : {1u, 4u, 16u}) {
    view.set_samples(samples);
    ASSERT_OK_AND_ASSIGN(const RenderResult image, connection().render(linear, frame_of(view, 37, 23)));
    const std::vector<HalfTexel> texels = texels_of(image.pixels());
    ASSERT_EQ(texels.size(), 37u * 23);
    for (const HalfTexel& texel : texels) ASSERT_NEAR(texel[0], 0.5f, 0.0005f);
    const absl::StatusOr<RenderResult> again = connection().render(linear, frame_of(view, 37, 23));
    ASSERT_EQ(image.bytes, again->bytes);
    EXPECT_EQ(std::memcmp(image.data.get(), again->data.get(), image.bytes), 0);
  }
}

TEST_F(EnvironmentService, ASmallerImageOfAViewIsTheMeanOfTheLargeOneAndIsExposedAsIt) {
  const v1::View view = view_of(put(*two_halves()), 10);
  v1::Settings settings;
  settings.mutable_bloom()->set_intensity(0);
  settings.mutable_exposure()->set_compensation_ev(-6);  // nothing clips
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  ASSERT_OK_AND_ASSIGN(const RenderResult large, connection().render(settings, frame_of(view, 48, 32)));
  settings.mutable_output_size()->set_width(24);
  ASSERT_OK_AND_ASSIGN(const RenderResult small, connection().render(settings, frame_of(view, 48, 32)));
  EXPECT_EQ(small.header.exposure(), large.header.exposure());
  ASSERT_EQ(small.header.width(), 24u);
  ASSERT_EQ(small.header.height(), 16u);
  const std::vector<HalfTexel> from = texels_of(large.pixels()), to = texels_of(small.pixels());
  ASSERT_EQ(to.size(), 24u * 16);
  for (size_t y = 0; y < 16; ++y) {
    for (size_t x = 0; x < 24; ++x) {
      const HalfTexel* const above = &from[2 * y * 48 + 2 * x];
      const float mean = (above[0][0] + above[1][0] + above[48][0] + above[49][0]) / 4;
      ASSERT_NEAR(to[y * 24 + x][0], mean, 0.001f * mean) << x << " " << y;
    }
  }
}

TEST_F(EnvironmentService, TheRightHalfOfThePanoramaIsToTheRight) {
  const std::string id = put(*two_halves());
  const auto brightness = [&](double yaw_deg, double rotation_deg) {
    v1::View view = view_of(id, yaw_deg);
    view.set_rotation_deg(rotation_deg);
    const absl::StatusOr<v1::MeterResponse> metered = connection().meter({}, frame_of(view));
    EXPECT_OK(metered);
    return metered.ok() ? metered->statistics().mean_log2_luminance() : 0.0;
  };
  EXPECT_GT(brightness(90, 0), brightness(-90, 0) + 6);
  // A turn by +180 brings the left to the right.
  EXPECT_LT(brightness(90, 180), brightness(-90, 180) - 6);
  // +90 moves what was to the right ahead.
  EXPECT_NEAR(brightness(0, 90), brightness(90, 0), 1e-3);
}

TEST_F(EnvironmentService, AViewOfAnEnvironmentThatIsNotThereNamesIt) {
  const std::string id = environment_id(*uniform(0.5f));
  EXPECT_REFUSED(kNotFound, id, connection().render({}, frame_of(view_of(id))));
  EXPECT_REFUSED(kInvalidArgument, "view.environment", connection().render({}, frame_of(view_of("sky"))));
}

TEST_F(EnvironmentService, ABadViewIsRefusedWithItsFieldAndRange) {
  const v1::View good = view_of(put(*uniform(0.5f)));
  const std::pair<void (*)(v1::View&), const char*> table[] = {
      {[](auto& v) { v.mutable_camera()->set_fov_deg(170.5); },
       "view.camera.fov_deg is 170.5; it must be 1 .. 170"},
      {[](auto& v) { v.mutable_camera()->set_yaw_deg(NAN); },
       "view.camera.yaw_deg is nan; it must be between -360000 and 360000"},
      {[](auto& v) { v.set_rotation_deg(361); }, "view.rotation_deg is 361; it must be between -360 and 360"},
      {[](auto& v) { v.set_samples(3); }, "view.samples is 3; it must be 1, 4 or 16"},
      {[](auto& v) { v.mutable_camera()->mutable_orientation()->set_w(2); },
       "the length of view.camera.orientation is 2; it must be 1"},
      {[](auto& v) {
         for (int i = 0; i < 65; ++i) v.add_objects()->set_radius(1);
       },
       "view.objects has 65 spheres; the limit is 64"},
      {[](auto& v) { v.add_objects()->set_radius(1); },
       "the camera is in view.objects[0], whose centre is 0 away and whose radius is 1"}};
  for (const auto& [spoil, words] : table) {
    v1::View view = good;
    spoil(view);
    EXPECT_REFUSED(kInvalidArgument, words, connection().render({}, frame_of(view)));
  }
  v1::Settings wide;
  wide.set_input_primaries(v1::PRIMARIES_REC2020);
  EXPECT_REFUSED(kInvalidArgument, "", connection().render(wide, frame_of(good)));
}

TEST_F(EnvironmentService, AHeaderWithAViewAndPixelsIsRefused) {
  const std::string id = put(*uniform(0.5f));
  for (const bool format : {true, false}) {
    OpenCall call(channel());
    v1::RenderRequest request;
    v1::FrameHeader& header = *request.mutable_start()->mutable_frame();
    header.set_width(2);
    header.set_height(2);
    *header.mutable_view() = view_of(id);
    if (format) header.set_format(v1::PIXEL_FORMAT_RGBA16F);
    call.write(request);
    v1::RenderRequest band;
    band.mutable_band()->set_pixels(std::string(32, '\0'));
    call.write(band);
    call.stream->WritesDone();
    EXPECT_EQ(call.finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
}

// --- memory

TEST_F(EnvironmentService, ThoseUsedLastAreKeptWithinTheBudget) {
  restart_with(64, 8);
  ASSERT_OK_AND_ASSIGN(const v1::Environment first, connection().put_environment(*uniform(0.1f, 256)));
  ASSERT_GT(3 * first.memory_bytes(), 8u << 20);
  const std::string second = put(*uniform(0.2f, 256));
  ASSERT_OK(connection().get_environment(first.id()));
  const std::string third = put(*uniform(0.3f, 256));
  EXPECT_REFUSED(kNotFound, "", connection().get_environment(second));
  EXPECT_OK(connection().get_environment(third));
  EXPECT_OK(connection().get_environment(first.id()));
  EXPECT_REFUSED(kResourceExhausted, "environment-budget",
                 connection().put_environment(*uniform(0.4f, 2048)));
}

TEST_F(EnvironmentService, ByDefaultTheyGetAQuarterOfTheTexturesBudget) {
  ASSERT_OK_AND_ASSIGN(const v1::GetServerInfoResponse info, connection().server_info());
  ASSERT_GT(info.limits().memory_budget_bytes(), 0u);
  EXPECT_EQ(info.limits().environment_budget_bytes(), info.limits().memory_budget_bytes() / 4);
}

TEST_F(EnvironmentService, WhatASessionUsesIsNotTakenAway) {
  restart_with(64, 8);
  const std::string id = put(*uniform(0.1f, 256));
  ASSERT_OK_AND_ASSIGN(Session session, Session::open({channel()}, {}));
  SessionFrame frame{.width = 8, .height = 8};
  frame.view = view_of(id);
  const auto show = [&] {
    ASSERT_OK(session.submit(frame));
    ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.next_result());
    ASSERT_TRUE(result.has_value());
    EXPECT_EQ(result->sequence, frame.sequence);
    EXPECT_OK(result->status);
    ++frame.sequence;
    frame.media_time_ns = film_time_ns(frame.sequence);
  };
  show();
  for (const float value : {0.2f, 0.3f, 0.4f}) {
    const absl::Status status = connection().put_environment(*uniform(value, 256)).status();
    EXPECT_TRUE(status.ok() || absl::IsUnavailable(status)) << status;
  }
  EXPECT_OK(connection().get_environment(id));
  EXPECT_TRUE(connection().drop_environment(id)->in_use());
  // It is gone for others, and the session goes on as long as it names no other one.
  EXPECT_REFUSED(kNotFound, "", connection().get_environment(id));
  show();
  frame.view->add_objects()->set_radius(1);
  frame.view->mutable_objects(0)->mutable_centre()->set_z(-4);
  show();
  EXPECT_REFUSED(kNotFound, "", connection().render({}, frame_of(view_of(id))));
}

TEST_F(EnvironmentService, AFrameThatNeedsTheMemoryTakesItFromUnusedEnvironments) {
  restart_with(12, 12);
  std::vector<std::string> ids;
  for (const float value : {0.1f, 0.2f, 0.3f, 0.4f}) {
    ids.push_back(put(*uniform(value, 256)));
    ASSERT_OK(connection().render({}, frame_of(view_of(ids.back()))));
  }
  for (const std::string& id : ids) EXPECT_OK(connection().get_environment(id));
  FrameView frame{.width = 640, .height = 480};
  const std::vector<HalfTexel> pixels(640 * 480, HalfTexel{0.5f, 0.5f, 0.5f, 1.0f});
  frame.pixels = std::as_bytes(std::span(pixels));
  EXPECT_OK(connection().render({}, frame));
  EXPECT_REFUSED(kNotFound, "", connection().get_environment(ids.front()));
}

TEST_F(EnvironmentService, APanoramaBeyondTheLimitsIsRefusedByItsStart) {
  const auto stub = v1::RenderService::NewStub(channel());
  grpc::ClientContext context;
  v1::Environment environment;
  const auto call = stub->PutEnvironment(&context, &environment);
  v1::PutEnvironmentRequest request;
  request.mutable_start()->set_width(8193);
  request.mutable_start()->set_height(2);
  request.mutable_start()->set_format(v1::PIXEL_FORMAT_RGB9E5);
  call->Write(request);
  call->WritesDone();
  EXPECT_REFUSED(kResourceExhausted, "8193x2 pixels and the limit is 8192x4096", call->Finish());
}

TEST_F(EnvironmentService, BadValuesAreCountedOrRefused) {
  const auto spoilt = make_panorama(8, 4, [](uint32_t x, uint32_t y) {
    return std::array<float, 3>{x == 3 && y == 2 ? NAN : 1.0f, x == 5 ? -1.0f : 1.0f, 1.0f};
  });
  ASSERT_OK_AND_ASSIGN(const v1::Environment scrubbed, connection().put_environment(*spoilt));
  EXPECT_EQ(scrubbed.nan_components(), 1u);
  EXPECT_EQ(scrubbed.negative_components(), 4u);
  Panorama strict = *spoilt;
  strict.start.set_bad_values(v1::BAD_VALUES_REJECT);
  EXPECT_REFUSED(kInvalidArgument, "(3, 2)", connection().put_environment(strict));
}

// Sessions whose frames are views of environments.

class EnvironmentSession : public EnvironmentService {
 protected:
  absl::StatusOr<Session> open(const SessionOptions& options = {}) const {
    return Session::open({channel()}, options);
  }
};

// A camera that turns over the panorama, one frame in three from pixels.
SessionRun turn(absl::StatusOr<Session> session, const std::shared_ptr<const Panorama>& panorama, bool bring,
                const std::function<void(size_t)>& on_result = {}) {
  const auto pixels = std::make_shared<std::vector<HalfTexel>>(24 * 16, HalfTexel{0.5f, 0.25f, 1.0f, 1.0f});
  const auto frame_at = [&](size_t i) {
    SessionFrame frame{.width = 24, .height = 16, .sequence = i, .media_time_ns = film_time_ns(i)};
    if (i % 3 == 2) {
      frame.pixels = std::as_bytes(std::span(*pixels));
      frame.owner = pixels;
    } else {
      frame.view = view_of(environment_id(*panorama), 15.0 * static_cast<double>(i));
      if (bring) frame.panorama = panorama;
    }
    return frame;
  };
  return run_frames(std::move(session), 0, 24, frame_at, on_result);
}

TEST_F(EnvironmentSession, ASessionMixesViewsAndPixelsAndAdaptsToBoth) {
  const auto panorama = two_halves();
  put(*panorama);
  const SessionRun shown = turn(open(), panorama, false);
  ASSERT_OK(shown.status);
  ASSERT_EQ(shown.images.size(), 24u);
  const std::vector<double> exposures = shown.exposures();
  EXPECT_NE(exposures.front(), exposures.back());
  // Frame 6 looks to the right, where it is bright, and frame 18 to the left. Each is between two views.
  const size_t bright = 6, dark = 18;
  EXPECT_GT(shown.headers[dark].target(), 100 * shown.headers[bright].target());
  EXPECT_GT(exposures[dark], 1.1 * exposures[bright]);
  for (const size_t i : {bright, dark}) {
    const double before = exposures[i - 1], target = shown.headers[i].target();
    EXPECT_GE(exposures[i], std::min(before, target)) << i;
    EXPECT_LE(exposures[i], std::max(before, target)) << i;
    EXPECT_NE(exposures[i], target) << i;
  }
  const SessionRun again = turn(open(), panorama, false);
  EXPECT_EQ(shown.images, again.images);
  EXPECT_EQ(exposures, again.exposures());
}

TEST_F(EnvironmentSession, ASessionEndsBeforeAViewOfWhatTheServerDoesNotHave) {
  const auto panorama = two_halves();
  const SessionRun shown = turn(open(), panorama, false);
  EXPECT_REFUSED(kNotFound, environment_id(*panorama), shown.status);
  EXPECT_TRUE(shown.images.empty());
}

TEST_F(EnvironmentSession, AFrameBeforeAViewOfWhatTheServerDoesNotHaveGetsItsResult) {
  const std::string id = environment_id(*two_halves());
  ASSERT_OK_AND_ASSIGN(Session session, open());
  const std::vector<HalfTexel> pixels(24 * 16, HalfTexel{0.5f, 0.25f, 1.0f, 1.0f});
  SessionFrame frame{.width = 24, .height = 16, .pixels = std::as_bytes(std::span(pixels))};
  ASSERT_OK(session.submit(frame));
  frame = {.width = 24, .height = 16, .sequence = 1, .media_time_ns = film_time_ns(1)};
  frame.view = view_of(id);
  ASSERT_OK(session.submit(frame));
  ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> first, session.next_result());
  ASSERT_TRUE(first.has_value());
  EXPECT_OK(first->status);
  EXPECT_GT(first->image.bytes, 0u);
  EXPECT_REFUSED(kNotFound, id, session.next_result());
}

TEST_F(EnvironmentSession, ASessionBringsItsPanoramaToAServerThatNeverSawIt) {
  const auto panorama = two_halves();
  const SessionRun shown = turn(open(), panorama, true);
  ASSERT_OK(shown.status);
  put(*panorama);
  const SessionRun there = turn(open(), panorama, false);
  EXPECT_EQ(shown.images, there.images);
}

// The environment goes while the session runs, as with a lost device or another server.
TEST_F(EnvironmentSession, ASessionThatLosesItsServerGoesOnElsewhereWithTheSameBits) {
  const auto panorama = two_halves();
  Config config = test_config();
  const TemporaryFile keys("00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff\n");
  config.resume_keys = keys.path();
  restart(config);
  put(*panorama);
  const SessionRun whole = turn(open(), panorama, true);
  ASSERT_OK(whole.status);

  // It moves twice, because the second move must find the panorama missing as the first one did.
  const std::unique_ptr<Server> second = start_server(config), third = start_server(config);
  SessionOptions options;
  options.servers = {server_->addresses().front(), second->addresses().front(), third->addresses().front()};
  const SessionRun moved = turn(Session::open(options), panorama, true, [&](size_t results) {
    if (results == 6) server_->drain_and_stop();
    if (results == 14) second->drain_and_stop();
  });
  ASSERT_OK(moved.status);
  EXPECT_GE(moved.stats.resumes, 2u);
  EXPECT_EQ(moved.images, whole.images);
  EXPECT_EQ(moved.exposures(), whole.exposures());
}

TEST_F(EnvironmentSession, WorksWithLookAhead) {
  const auto panorama = two_halves();
  put(*panorama);
  SessionOptions options;
  options.lookahead = 3;
  const SessionRun shown = turn(open(options), panorama, false);
  EXPECT_OK(shown.status);
  EXPECT_EQ(shown.images.size(), 24u);
}

TEST_F(EnvironmentSession, ThoseOfALostDeviceGoWithIt) {
  Config config = test_config();
  config.metrics = "127.0.0.1:0";
  restart(config);
  const auto panorama = two_halves();
  ASSERT_OK_AND_ASSIGN(const v1::Environment kept, connection().put_environment(*panorama));
  EXPECT_EQ(scrape(*server_).at("candela_environment_bytes"), kept.memory_bytes());
  server_->lose_device();
  EXPECT_REFUSED(kUnavailable, "", connection().render({}, frame_of(view_of(kept.id()))));
  EXPECT_REFUSED(kNotFound, "", connection().get_environment(kept.id()));
  // The call that failed was the last to use it.
  const absl::Time end = absl::Now() + absl::Seconds(10);
  while (scrape(*server_).at("candela_environment_bytes") > 0 && absl::Now() < end) {
    absl::SleepFor(absl::Milliseconds(10));
  }
  EXPECT_EQ(scrape(*server_).at("candela_environment_bytes"), 0);
  const SessionRun shown = turn(open(), panorama, true);
  EXPECT_OK(shown.status);
}

// Bakes of environments on a server.

using EnvironmentBakes = EnvironmentService;

// As RGBA16F.
v1::BakeEnvironmentRequest bake_of(const std::string& id) {
  v1::BakeEnvironmentRequest request;
  request.set_id(id);
  request.set_format(v1::PIXEL_FORMAT_RGBA16F);
  return request;
}

TEST_F(EnvironmentBakes, ABakeOfAUniformPanoramaIsUniformInEveryLevelAndFormat) {
  v1::BakeEnvironmentRequest request = bake_of(put(*uniform(0.5f, 256)));
  request.set_size(64);
  for (const v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGB9E5}) {
    request.set_format(format);
    ASSERT_OK_AND_ASSIGN(const EnvironmentBake bake, connection().bake_environment(request));
    ASSERT_EQ(bake.levels.size(), 3u);
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(bake.header.levels(i).size(), 64u >> i);
      EXPECT_NEAR(bake.header.levels(i).roughness(), 0.5 * i, 1e-6);
    }
    if (format != v1::PIXEL_FORMAT_RGBA16F) continue;
    for (const std::vector<std::byte>& level : bake.levels) {
      for (const HalfTexel& texel : texels_of(level)) ASSERT_NEAR(texel[1], 0.5f, 0.001f);
    }
  }
}

TEST_F(EnvironmentBakes, AskedForLevelsAreThoseOfTheWholeBake) {
  const auto panorama = make_panorama(128, 64, [](uint32_t x, uint32_t y) {
    return std::array<float, 3>{0.01f * static_cast<float>(x), 0.02f * static_cast<float>(y),
                                x < 9 ? 9.0f : 1};
  });
  v1::BakeEnvironmentRequest request = bake_of(put(*panorama));
  request.set_size(64);
  ASSERT_OK_AND_ASSIGN(const EnvironmentBake whole, connection().bake_environment(request));
  ASSERT_EQ(whole.levels.size(), 3u);
  for (uint32_t levels = 1; levels <= 3; ++levels) {
    request.set_levels(levels);
    ASSERT_OK_AND_ASSIGN(const EnvironmentBake bake, connection().bake_environment(request));
    ASSERT_EQ(bake.levels.size(), levels);
    for (uint32_t i = 0; i < levels; ++i) {
      const int row = static_cast<int>(i);
      EXPECT_EQ(bake.header.levels(row).roughness(), whole.header.levels(row).roughness());
      EXPECT_TRUE(bake.levels[i] == whole.levels[i]) << levels << ": " << i;
    }
  }
}

TEST_F(EnvironmentBakes, OnlyTheLevelsThatAreAskedForTakeMemory) {
  restart_with(11, 4);
  const bool unified = connection().server_info()->device().unified_memory();
  v1::BakeEnvironmentRequest request = bake_of(put(*uniform(0.5f)));
  request.set_size(256);
  for (const uint32_t levels : {0u, 4u, 3u}) {
    request.set_levels(levels);
    const uint32_t made = levels == 0 ? 5 : levels;
    uint64_t bytes = chain_bytes(256) + cube_bytes(128, made - 1);
    if (!unified) bytes += cube_bytes(256, 1) / 6;  // the copy of a face
    for (uint32_t level = 0; level < made; ++level)
      bytes += uint64_t{6 * 8} * (256 >> level) * (256 >> level);
    EXPECT_REFUSED(kResourceExhausted, absl::StrCat("needs ", bytes, " bytes"),
                   connection().bake_environment(request));
  }
  // Level 0 and its faces on the wire fit.
  request.set_levels(1);
  EXPECT_OK(connection().bake_environment(request));
}

TEST_F(EnvironmentBakes, WhatRgb9e5DoesNotHoldIsCountedOverTheFacesThatAreSent) {
  v1::BakeEnvironmentRequest request = bake_of(put(*make_panorama(64, 32, [](uint32_t, uint32_t) {
    return std::array<float, 3>{-1.0f, 65504.0f, 0.5f};
  })));
  request.set_size(32);
  const auto bake = [&](v1::PixelFormat format, uint32_t levels) {
    request.set_format(format);
    request.set_levels(levels);
    const absl::StatusOr<EnvironmentBake> baked = connection().bake_environment(request);
    EXPECT_OK(baked);
    return baked.ok() ? baked->header : v1::BakeHeader();
  };
  const uint64_t first = 6 * 32 * 32, both = first + 6 * 16 * 16;
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGB9E5, 1).negative_components(), first);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGB9E5, 2).negative_components(), both);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGB9E5, 2).clamped_components(), both);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGBA16F, 2).negative_components(), 0u);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGBA16F, 2).clamped_components(), 0u);
}

TEST_F(EnvironmentBakes, AVerifiedBakeSaysTheErrorOfEachLevel) {
  const auto panorama = make_panorama(256, 128, [](uint32_t x, uint32_t y) {
    const float wave = std::sin(0.2f * static_cast<float>(x)) * std::cos(0.15f * static_cast<float>(y));
    return std::array<float, 3>{1.5f + wave, 1.0f - 0.5f * wave, x > 100 && x < 110 && y < 40 ? 30.0f : 0.2f};
  });
  v1::BakeEnvironmentRequest request = bake_of(put(*panorama));
  request.set_rotation_deg(33);
  EXPECT_FALSE(connection().bake_environment(request)->header.levels(0).has_error());
  request.set_verify(true);
  double error_of_draft = 0;
  for (const auto& [tier, most] : {std::pair("draft", 0.08), {"standard", 0.02}, {"reference", 0.003}}) {
    request.set_tier(tier);
    ASSERT_OK_AND_ASSIGN(const EnvironmentBake bake, connection().bake_environment(request));
    double sum = 0;
    for (const v1::BakedLevel& level : bake.header.levels()) {
      ASSERT_TRUE(level.has_error());
      EXPECT_LE(level.error(), most) << tier << ", level of " << level.size();
      sum += level.error();
    }
    if (error_of_draft == 0) error_of_draft = sum;
    EXPECT_GT(sum, 0);
    EXPECT_LE(sum, error_of_draft) << tier;
  }
}

TEST_F(EnvironmentBakes, ABadBakeIsRefused) {
  v1::BakeEnvironmentRequest good = bake_of(put(*uniform(0.5f)));
  const auto refused = [&](const std::function<void(v1::BakeEnvironmentRequest&)>& spoil, const char* field) {
    v1::BakeEnvironmentRequest request = good;
    spoil(request);
    EXPECT_REFUSED(kInvalidArgument, field, connection().bake_environment(request));
  };
  refused([](auto& r) { r.set_size(48); }, "size is 48; it must be a power of two between 16 and 4096");
  refused([](auto& r) { r.set_size(8192); }, "size is 8192; it must be a power of two between 16 and 4096");
  refused([](auto& r) { r.set_levels(9); }, "levels is 9; a cube of ");
  refused([](auto& r) { r.clear_format(); }, "format is 0; a bake is RGBA16F (1), RGBA32F (2) or RGB9E5 (3)");
  refused([](auto& r) { r.set_tier("best"); }, "tier is 'best'");
  refused([](auto& r) { r.set_rotation_deg(NAN); }, "rotation_deg is nan; it must be between -360 and 360");
  refused([](auto& r) { r.set_id("x"); }, "id");
}

}  // namespace
}  // namespace candela::testing
