// Environments on a server: put, looked at, shared and dropped.
#include <cmath>
#include <optional>

#include "client/session.h"
#include "tests/service/environments/environment_fixture.h"
#include "tests/service/sessions/stream_client.h"
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

}  // namespace
}  // namespace candela::testing
