// Environments on a server: put, looked at, baked, shared and dropped.
#include "client/environment.h"

#include <Imath/half.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/session.h"
#include "proto/candela/v1/environment_id.h"
#include "server/render/environment/cube_levels.h"
#include "tests/service/server/scrape.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

using Texel = std::array<Imath::half, 4>;

// A panorama of halves. `color` gives R, G and B of texel (x, y).
template <typename Color>
std::shared_ptr<const Panorama> make_panorama(uint32_t width, uint32_t height, Color color) {
  auto texels = std::make_shared<std::vector<Texel>>();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const std::array<float, 3> c = color(x, y);
      texels->push_back({c[0], c[1], c[2], 1.0f});
    }
  }
  auto panorama = std::make_shared<Panorama>();
  panorama->start.set_width(width);
  panorama->start.set_height(height);
  panorama->start.set_format(v1::PIXEL_FORMAT_RGBA16F);
  panorama->pixels = std::as_bytes(std::span(*texels));
  panorama->owner = texels;
  return panorama;
}

std::shared_ptr<const Panorama> uniform(float value, uint32_t width = 64) {
  return make_panorama(width, width / 2, [value](uint32_t, uint32_t) {
    return std::array<float, 3>{value, value, value};
  });
}

// Bright on the right half and dark on the left, so that a turning camera has to adapt.
std::shared_ptr<const Panorama> two_halves() {
  return make_panorama(64, 32, [](uint32_t x, uint32_t y) {
    const float value = (x < 32 ? 0.05f : 20.0f) * (1.0f + 0.01f * static_cast<float>(y));
    return std::array<float, 3>{value, 0.5f * value, 0.25f * value};
  });
}

v1::View view_of(const std::string& id, double yaw_deg = 0) {
  v1::View view;
  view.set_environment(id);
  view.mutable_camera()->set_yaw_deg(yaw_deg);
  return view;
}

// Linear light, unchanged, as halves.
v1::Settings plain() {
  v1::Settings settings;
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_bloom()->set_intensity(0);
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  return settings;
}

FrameView frame_of(const v1::View& view, uint32_t width = 24, uint32_t height = 16) {
  FrameView frame{.width = width, .height = height};
  frame.view = view;
  return frame;
}

std::vector<Texel> texels_of(std::span<const std::byte> bytes) {
  std::vector<Texel> texels(bytes.size() / sizeof(Texel));
  std::memcpy(texels.data(), bytes.data(), bytes.size());
  return texels;
}

class EnvironmentService : public ::testing::Test {
 protected:
  void restart(const Config& config) {
    server_.reset();
    server_ = start_server(config);
  }
  void SetUp() override { restart(test_config()); }

  Connection connection() const { return Connection(server_->in_process_channel()); }
  std::string put(const Panorama& panorama) const {
    const absl::StatusOr<v1::Environment> environment = connection().put_environment(panorama);
    EXPECT_OK(environment);
    return environment.ok() ? environment->id() : "";
  }

  std::unique_ptr<Server> server_;
};

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
  EXPECT_TRUE(absl::IsNotFound(connection().drop_environment(first.id()).status()));
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
  for (const uint32_t samples : {1u, 4u, 16u}) {
    view.set_samples(samples);
    ASSERT_OK_AND_ASSIGN(const RenderResult image, connection().render(plain(), frame_of(view, 37, 23)));
    const std::vector<Texel> texels = texels_of(image.pixels());
    ASSERT_EQ(texels.size(), 37u * 23);
    for (const Texel& texel : texels) ASSERT_NEAR(texel[0], 0.5f, 0.0005f);
    const absl::StatusOr<RenderResult> again = connection().render(plain(), frame_of(view, 37, 23));
    ASSERT_EQ(image.bytes, again->bytes);
    EXPECT_EQ(std::memcmp(image.data.get(), again->data.get(), image.bytes), 0);
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
  const auto refused = [&](const std::function<void(v1::View&)>& spoil) {
    v1::View view = good;
    spoil(view);
    const absl::Status status = connection().render({}, frame_of(view)).status();
    EXPECT_REFUSED(kInvalidArgument, "", status);
    return std::string(status.message());
  };
  const auto names = [](const std::string& message, const char* field) {
    return message.find(field) != std::string::npos;
  };
  EXPECT_TRUE(names(refused([](v1::View& v) { v.mutable_camera()->set_fov_deg(170.5); }),
                    "view.camera.fov_deg is 170.5; it must be 1 .. 170"));
  EXPECT_TRUE(names(refused([](v1::View& v) { v.mutable_camera()->set_yaw_deg(NAN); }),
                    "view.camera.yaw_deg is nan; it must be between -360000 and 360000"));
  EXPECT_TRUE(names(refused([](v1::View& v) { v.set_rotation_deg(361); }),
                    "view.rotation_deg is 361; it must be between -360 and 360"));
  EXPECT_TRUE(
      names(refused([](v1::View& v) { v.set_samples(3); }), "view.samples is 3; it must be 1, 4 or 16"));
  EXPECT_TRUE(names(refused([](v1::View& v) { v.mutable_camera()->mutable_orientation()->set_w(2); }),
                    "the length of view.camera.orientation is 2; it must be 1"));
  EXPECT_TRUE(names(refused([](v1::View& v) {
                      for (int i = 0; i < 65; ++i) v.add_objects()->set_radius(1);
                    }),
                    "view.objects has 65 spheres; the limit is 64"));
  // The camera is inside of this one.
  EXPECT_TRUE(names(refused([](v1::View& v) { v.add_objects()->set_radius(1); }),
                    "the camera is in view.objects[0], whose centre is 0 away and whose radius is 1"));
  v1::Settings wide;
  wide.set_input_primaries(v1::PRIMARIES_REC2020);
  EXPECT_TRUE(absl::IsInvalidArgument(connection().render(wide, frame_of(good)).status()));
}

TEST_F(EnvironmentService, AHeaderWithAViewAndPixelsIsRefused) {
  const std::string id = put(*uniform(0.5f));
  const auto stub = v1::RenderService::NewStub(server_->in_process_channel());
  for (const bool format : {true, false}) {
    grpc::ClientContext context;
    const auto call = stub->Render(&context);
    v1::RenderRequest request;
    v1::FrameHeader& header = *request.mutable_start()->mutable_frame();
    header.set_width(2);
    header.set_height(2);
    *header.mutable_view() = view_of(id);
    if (format) header.set_format(v1::PIXEL_FORMAT_RGBA16F);
    call->Write(request);
    v1::RenderRequest band;
    band.mutable_band()->set_pixels(std::string(32, '\0'));
    call->Write(band);
    call->WritesDone();
    EXPECT_EQ(call->Finish().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  }
}

// --- sessions

struct Shown {
  absl::Status status;
  std::vector<std::string> images;
  std::vector<double> exposures;
  std::vector<double> targets;
  SessionStats stats;
};

// A camera that turns over the panorama, one frame in three from pixels.
Shown turn(absl::StatusOr<Session> session, const std::shared_ptr<const Panorama>& panorama, bool bring,
           const std::function<void(size_t)>& on_result = {}) {
  Shown shown{session.status(), {}, {}, {}, {}};
  if (!session.ok()) return shown;
  const auto pixels = std::make_shared<std::vector<Texel>>(24 * 16, Texel{0.5f, 0.25f, 1.0f, 1.0f});
  std::thread producer([&] {
    for (uint64_t i = 0; i < 24; ++i) {
      SessionFrame frame{.width = 24, .height = 16};
      frame.sequence = i;
      frame.media_time_ns = film_time_ns(i);
      if (i % 3 == 2) {
        frame.pixels = std::as_bytes(std::span(*pixels));
        frame.owner = pixels;
      } else {
        frame.view = view_of(environment_id(*panorama), 15.0 * static_cast<double>(i));
        if (bring) frame.panorama = panorama;
      }
      if (!session->submit(std::move(frame)).ok()) break;
    }
    session->finish();
  });
  absl::StatusOr<std::optional<FrameResult>> result;
  while ((result = session->next_result()).ok() && result->has_value()) {
    EXPECT_EQ((*result)->sequence, shown.images.size());
    shown.images.emplace_back(reinterpret_cast<const char*>((*result)->image.data.get()),
                              (*result)->image.bytes);
    shown.exposures.push_back((*result)->image.header.exposure());
    shown.targets.push_back((*result)->image.header.target());
    if (on_result) on_result(shown.images.size());
  }
  shown.status = result.status();
  shown.stats = session->stats();
  session->cancel();
  producer.join();
  return shown;
}

TEST_F(EnvironmentService, ASessionMixesViewsAndPixelsAndAdaptsToBoth) {
  const auto panorama = two_halves();
  put(*panorama);
  const Shown shown = turn(Session::open({server_->in_process_channel()}, {}), panorama, false);
  ASSERT_OK(shown.status);
  ASSERT_EQ(shown.images.size(), 24u);
  EXPECT_NE(shown.exposures.front(), shown.exposures.back());
  // Frame 6 looks to the right, where it is bright, and frame 18 to the left. Each is between two views.
  const size_t bright = 6, dark = 18;
  EXPECT_GT(shown.targets[dark], 100 * shown.targets[bright]);
  EXPECT_GT(shown.exposures[dark], 1.1 * shown.exposures[bright]);
  for (const size_t i : {bright, dark}) {
    const double before = shown.exposures[i - 1], target = shown.targets[i];
    EXPECT_GE(shown.exposures[i], std::min(before, target)) << i;
    EXPECT_LE(shown.exposures[i], std::max(before, target)) << i;
    EXPECT_NE(shown.exposures[i], target) << i;
  }
  const Shown again = turn(Session::open({server_->in_process_channel()}, {}), panorama, false);
  EXPECT_EQ(shown.images, again.images);
  EXPECT_EQ(shown.exposures, again.exposures);
}

TEST_F(EnvironmentService, ASessionEndsBeforeAViewOfWhatTheServerDoesNotHave) {
  const auto panorama = two_halves();
  const Shown shown = turn(Session::open({server_->in_process_channel()}, {}), panorama, false);
  EXPECT_REFUSED(kNotFound, environment_id(*panorama), shown.status);
  EXPECT_TRUE(shown.images.empty());
}

TEST_F(EnvironmentService, AFrameBeforeAViewOfWhatTheServerDoesNotHaveGetsItsResult) {
  const std::string id = environment_id(*two_halves());
  ASSERT_OK_AND_ASSIGN(Session session, Session::open({server_->in_process_channel()}, {}));
  const std::vector<Texel> pixels(24 * 16, Texel{0.5f, 0.25f, 1.0f, 1.0f});
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

TEST_F(EnvironmentService, ASessionBringsItsPanoramaToAServerThatNeverSawIt) {
  const auto panorama = two_halves();
  const Shown shown = turn(Session::open({server_->in_process_channel()}, {}), panorama, true);
  ASSERT_OK(shown.status);
  put(*panorama);
  const Shown there = turn(Session::open({server_->in_process_channel()}, {}), panorama, false);
  EXPECT_EQ(shown.images, there.images);
}

// The environment goes while the session runs, as with a lost device or another server.
TEST_F(EnvironmentService, ASessionThatLosesItsServerGoesOnElsewhereWithTheSameBits) {
  const auto panorama = two_halves();
  Config config = test_config();
  config.resume_keys = ::testing::TempDir() + "/environment.keys";
  FILE* keys = fopen(config.resume_keys.c_str(), "w");
  ASSERT_NE(keys, nullptr);
  fputs("00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff\n", keys);
  fclose(keys);
  ASSERT_EQ(chmod(config.resume_keys.c_str(), 0600), 0);
  restart(config);
  put(*panorama);
  const Shown whole = turn(Session::open({server_->in_process_channel()}, {}), panorama, true);
  ASSERT_OK(whole.status);

  // It moves twice, because the second move must find the panorama missing as the first one did.
  const std::unique_ptr<Server> second = start_server(config), third = start_server(config);
  SessionOptions options;
  options.servers = {server_->addresses().front(), second->addresses().front(), third->addresses().front()};
  const Shown moved = turn(Session::open(options), panorama, true, [&](size_t results) {
    if (results == 6) server_->drain_and_stop();
    if (results == 14) second->drain_and_stop();
  });
  ASSERT_OK(moved.status);
  EXPECT_GE(moved.stats.resumes, 2u);
  EXPECT_EQ(moved.images, whole.images);
  EXPECT_EQ(moved.exposures, whole.exposures);
}

TEST_F(EnvironmentService, WorksWithLookAhead) {
  const auto panorama = two_halves();
  put(*panorama);
  SessionOptions options;
  options.lookahead = 3;
  const Shown shown = turn(Session::open({server_->in_process_channel()}, options), panorama, false);
  EXPECT_OK(shown.status);
  EXPECT_EQ(shown.images.size(), 24u);
}

TEST_F(EnvironmentService, ThoseOfALostDeviceGoWithIt) {
  Config config = test_config();
  config.metrics = "127.0.0.1:0";
  restart(config);
  const auto panorama = two_halves();
  ASSERT_OK_AND_ASSIGN(const v1::Environment kept, connection().put_environment(*panorama));
  EXPECT_EQ(scrape(*server_).at("candela_environment_bytes"), kept.memory_bytes());
  server_->lose_device();
  EXPECT_TRUE(absl::IsUnavailable(connection().render({}, frame_of(view_of(kept.id()))).status()));
  EXPECT_TRUE(absl::IsNotFound(connection().get_environment(kept.id()).status()));
  // The call that failed was the last to use it.
  const absl::Time end = absl::Now() + absl::Seconds(10);
  while (scrape(*server_).at("candela_environment_bytes") > 0 && absl::Now() < end) {
    absl::SleepFor(absl::Milliseconds(10));
  }
  EXPECT_EQ(scrape(*server_).at("candela_environment_bytes"), 0);
  const Shown shown = turn(Session::open({server_->in_process_channel()}, {}), panorama, true);
  EXPECT_OK(shown.status);
}

// --- bakes

TEST_F(EnvironmentService, ABakeOfAUniformPanoramaIsUniformInEveryLevelAndFormat) {
  v1::BakeEnvironmentRequest request;
  request.set_id(put(*uniform(0.5f, 256)));
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
      for (const Texel& texel : texels_of(level)) ASSERT_NEAR(texel[1], 0.5f, 0.001f);
    }
  }
}

TEST_F(EnvironmentService, AskedForLevelsAreThoseOfTheWholeBake) {
  const auto panorama = make_panorama(128, 64, [](uint32_t x, uint32_t y) {
    return std::array<float, 3>{0.01f * static_cast<float>(x), 0.02f * static_cast<float>(y),
                                x < 9 ? 9.0f : 1};
  });
  v1::BakeEnvironmentRequest request;
  request.set_id(put(*panorama));
  request.set_format(v1::PIXEL_FORMAT_RGBA16F);
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

TEST_F(EnvironmentService, OnlyTheLevelsThatAreAskedForTakeMemory) {
  Config config = test_config();
  config.memory_budget_bytes = 11 << 20;
  config.environment_budget_bytes = 4 << 20;
  restart(config);
  const bool unified = connection().server_info()->device().unified_memory();
  v1::BakeEnvironmentRequest request;
  request.set_id(put(*uniform(0.5f)));
  request.set_format(v1::PIXEL_FORMAT_RGBA16F);
  request.set_size(256);
  for (const uint32_t levels : {0u, 4u, 3u}) {
    request.set_levels(levels);
    const absl::Status large = connection().bake_environment(request).status();
    EXPECT_REFUSED(kResourceExhausted, "", large);
    const uint32_t made = levels == 0 ? 5 : levels;
    uint64_t bytes = chain_bytes(256) + cube_bytes(128, made - 1);
    if (!unified) bytes += cube_bytes(256, 1) / 6;  // the copy of a face
    for (uint32_t level = 0; level < made; ++level)
      bytes += uint64_t{6 * 8} * (256 >> level) * (256 >> level);
    EXPECT_NE(large.message().find(absl::StrCat("needs ", bytes, " bytes")), std::string::npos) << large;
  }
  // Level 0 and its faces on the wire fit.
  request.set_levels(1);
  EXPECT_OK(connection().bake_environment(request));
}

TEST_F(EnvironmentService, WhatRgb9e5DoesNotHoldIsCountedOverTheFacesThatAreSent) {
  v1::BakeEnvironmentRequest request;
  request.set_id(put(*make_panorama(64, 32, [](uint32_t, uint32_t) {
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

TEST_F(EnvironmentService, AVerifiedBakeSaysTheErrorOfEachLevel) {
  const auto panorama = make_panorama(256, 128, [](uint32_t x, uint32_t y) {
    const float wave = std::sin(0.2f * static_cast<float>(x)) * std::cos(0.15f * static_cast<float>(y));
    return std::array<float, 3>{1.5f + wave, 1.0f - 0.5f * wave, x > 100 && x < 110 && y < 40 ? 30.0f : 0.2f};
  });
  v1::BakeEnvironmentRequest request;
  request.set_id(put(*panorama));
  request.set_format(v1::PIXEL_FORMAT_RGBA16F);
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

TEST_F(EnvironmentService, ABadBakeIsRefused) {
  v1::BakeEnvironmentRequest good;
  good.set_id(put(*uniform(0.5f)));
  good.set_format(v1::PIXEL_FORMAT_RGBA16F);
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

// --- memory

TEST_F(EnvironmentService, ThoseUsedLastAreKeptWithinTheBudget) {
  Config config = test_config();
  config.memory_budget_bytes = 64 << 20;
  config.environment_budget_bytes = 8 << 20;
  restart(config);
  ASSERT_OK_AND_ASSIGN(const v1::Environment first, connection().put_environment(*uniform(0.1f, 256)));
  ASSERT_GT(3 * first.memory_bytes(), config.environment_budget_bytes);
  const std::string second = put(*uniform(0.2f, 256));
  ASSERT_OK(connection().get_environment(first.id()));
  const std::string third = put(*uniform(0.3f, 256));
  EXPECT_TRUE(absl::IsNotFound(connection().get_environment(second).status()));
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
  Config config = test_config();
  config.memory_budget_bytes = 64 << 20;
  config.environment_budget_bytes = 8 << 20;
  restart(config);
  const std::string id = put(*uniform(0.1f, 256));
  ASSERT_OK_AND_ASSIGN(Session session, Session::open({server_->in_process_channel()}, {}));
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
  EXPECT_TRUE(absl::IsNotFound(connection().get_environment(id).status()));
  show();
  frame.view->add_objects()->set_radius(1);
  frame.view->mutable_objects(0)->mutable_centre()->set_z(-4);
  show();
  EXPECT_TRUE(absl::IsNotFound(connection().render({}, frame_of(view_of(id))).status()));
}

TEST_F(EnvironmentService, AFrameThatNeedsTheMemoryTakesItFromUnusedEnvironments) {
  Config config = test_config();
  config.memory_budget_bytes = 12 << 20;
  config.environment_budget_bytes = 12 << 20;
  restart(config);
  std::vector<std::string> ids;
  for (const float value : {0.1f, 0.2f, 0.3f, 0.4f}) {
    ids.push_back(put(*uniform(value, 256)));
    ASSERT_OK(connection().render({}, frame_of(view_of(ids.back()))));
  }
  for (const std::string& id : ids) EXPECT_OK(connection().get_environment(id));
  FrameView frame{.width = 640, .height = 480};
  const std::vector<Texel> pixels(640 * 480, Texel{0.5f, 0.5f, 0.5f, 1.0f});
  frame.pixels = std::as_bytes(std::span(pixels));
  EXPECT_OK(connection().render({}, frame));
  EXPECT_TRUE(absl::IsNotFound(connection().get_environment(ids.front()).status()));
}

TEST_F(EnvironmentService, APanoramaBeyondTheLimitsIsRefusedByItsStart) {
  const auto stub = v1::RenderService::NewStub(server_->in_process_channel());
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

}  // namespace
}  // namespace candela::testing
