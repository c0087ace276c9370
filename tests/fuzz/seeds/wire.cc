// Seeds of the wire target: calls of each kind.
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/fuzz/seeds/seeds.h"
#include "tests/fuzz/wire_input.h"
#include "tests/support/files.h"

namespace candela {
namespace {

std::string band(uint32_t first_row, size_t bytes) {
  v1::RenderRequest message;
  message.mutable_band()->set_first_row(first_row);
  message.mutable_band()->set_pixels(std::string(bytes, 'p'));
  return message.SerializeAsString();
}

std::string zstd_band(uint32_t first_row, uint32_t rows, v1::PixelFormat format) {
  const std::vector<std::byte> pixels(size_t{rows} * 3 * bytes_per_pixel(format), std::byte{'p'});
  v1::RowPacker packer;
  const grpc::Slice packed = packer.pack(pixels, 3, format);
  v1::RenderRequest message;
  message.mutable_band()->set_first_row(first_row);
  message.mutable_band()->set_zstd(packed.begin(), packed.size());
  return message.SerializeAsString();
}

// Every field except those that conflict with others, so that the fuzzer knows them all.
void set_all(v1::Settings& settings) {
  v1::Exposure& exposure = *settings.mutable_exposure();
  exposure.set_mode(v1::Exposure::MODE_MANUAL);
  exposure.set_manual_ev(-2);
  exposure.set_compensation_ev(1);
  exposure.set_key(0.2);
  exposure.set_min_exposure(0.5);
  exposure.set_max_exposure(2);
  v1::Metering& metering = *exposure.mutable_metering();
  metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
  metering.set_percentile_low(5);
  metering.set_percentile_high(95);
  metering.set_weights(v1::Metering::WEIGHTS_SPOT);
  metering.mutable_spot()->set_x0(1);
  metering.mutable_spot()->set_x1(2);
  metering.mutable_spot()->set_y0(1);
  metering.mutable_spot()->set_y1(3);
  v1::Adaptation& adaptation = *exposure.mutable_adaptation();
  adaptation.set_domain(v1::Adaptation::DOMAIN_LINEAR);
  adaptation.set_speed_up(2);
  adaptation.set_speed_down(0.5);
  v1::Bloom& bloom = *settings.mutable_bloom();
  bloom.set_intensity(0.1f);
  bloom.set_threshold(2);
  bloom.set_softness(0.25f);
  bloom.set_levels(3);
  bloom.set_firefly_weights(false);
  bloom.set_kind(v1::Bloom::KIND_GAUSSIAN);
  settings.set_curve(v1::TONE_CURVE_REINHARD_EXTENDED);
  settings.set_curve_white(8);
  settings.set_prescale(1.5);
  settings.set_transfer(v1::TRANSFER_GAMMA22);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  settings.set_tier("standard");
  settings.set_dither(true);
  v1::Chromaticities& xy = *settings.mutable_input_chromaticities();
  xy.set_red_x(0.7f);
  xy.set_red_y(0.3f);
  xy.set_green_x(0.2f);
  xy.set_green_y(0.7f);
  xy.set_blue_x(0.1f);
  xy.set_blue_y(0.1f);
  xy.set_white_x(0.31f);
  xy.set_white_y(0.33f);
}

// A frame of 3 x 4 pixels in two bands.
void write_request(const std::string& path, v1::PixelFormat format, uint32_t pixel_bytes, bool all_fields) {
  const uint32_t stride = 3 * pixel_bytes + (all_fields ? 5 : 0);
  v1::RenderRequest request;
  v1::FrameHeader& frame = *request.mutable_start()->mutable_frame();
  frame.set_width(3);
  frame.set_height(4);
  frame.set_format(format);
  if (all_fields) {
    frame.set_sequence(7);
    frame.set_row_stride_bytes(stride);
    frame.set_total_bytes(uint64_t{4} * stride);
    set_all(*request.mutable_start()->mutable_settings());
    request.mutable_start()->set_verify(true);
    request.mutable_start()->set_error_map(true);
    request.mutable_start()->mutable_previous()->set_exposure(1.5);
    request.mutable_start()->mutable_previous()->set_elapsed_seconds(0.04);
  } else {
    frame.set_exposure(kGivenExposure);
    v1::Settings& settings = *request.mutable_start()->mutable_settings();
    settings.set_max_error_codes(1);
    settings.set_input_primaries(v1::PRIMARIES_REC2020);
  }
  WireInput input;
  input.messages = {request.SerializeAsString(), band(0, size_t{3} * stride), band(3, stride)};
  write_file(path, format_wire_input(input));
  input.messages = {request.SerializeAsString(), zstd_band(0, 3, format), zstd_band(3, 1, format)};
  write_file(path + "_zstd", format_wire_input(input));
  frame.mutable_memory()->set_ticket("0123456789abcdef");
  frame.mutable_memory()->set_pixels_offset(128);
  frame.mutable_memory()->set_image_offset(4096);
  input.messages = {request.SerializeAsString()};
  write_file(path + "_in_memory", format_wire_input(input));
}

std::string map_band(uint32_t first_row, size_t bytes) {
  v1::RenderResponse message;
  message.mutable_error_map()->set_first_row(first_row);
  message.mutable_error_map()->set_pixels(std::string(bytes, 'e'));
  return message.SerializeAsString();
}

void write_response(const std::string& path, v1::OutputFormat format, uint32_t pixel_bytes, bool error_map) {
  v1::RenderResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_sequence(7);
  header.set_width(3);
  header.set_height(4);
  header.set_format(format);
  header.mutable_statistics()->set_mean_log2_luminance(-1);
  header.set_exposure(2);
  header.add_plan("ingest");
  header.add_stages()->set_name("queue");
  header.set_tier("standard");
  if (error_map) header.mutable_verify()->set_max_error_codes(0.5);
  WireInput input{.reader = WireInput::Reader::kClient,
                  .error_map = error_map,
                  .slice_bytes = 5,
                  .width = 3,
                  .height = 4};
  input.messages = {response.SerializeAsString(), band(0, size_t{9} * pixel_bytes),
                    band(3, size_t{3} * pixel_bytes)};
  if (error_map) {
    input.messages.push_back(map_band(0, 18));
    input.messages.push_back(map_band(3, 6));
  }
  write_file(path, format_wire_input(input));
}

v1::StreamResponse stream_header(uint64_t sequence, uint64_t encoded_bytes) {
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_sequence(sequence);
  header.set_width(3);
  header.set_height(4);
  header.set_format(v1::OUTPUT_FORMAT_RGBA16);
  header.set_resume_token("token");
  header.set_encoded_bytes(encoded_bytes);
  return response;
}

// A session's three results: an image in bands, an image as a file, and a failure. Then the connection ends.
void write_session(const std::string& path, bool alpha_left_out) {
  WireInput input{.reader = WireInput::Reader::kSession, .slice_bytes = 7, .width = 3, .height = 4};
  v1::StreamResponse opened, part, failure, away;
  opened.mutable_opened()->set_session("fuzz");
  opened.mutable_opened()->set_max_frames_in_flight(2);
  part.mutable_encoded()->set_data("file!");
  failure.mutable_failure()->set_sequence(2);
  failure.mutable_failure()->set_code(4);
  failure.mutable_failure()->set_message("late");
  failure.mutable_failure()->set_resume_token("token");
  away.mutable_go_away()->set_reason("draining");
  v1::StreamResponse image = stream_header(0, 0);
  image.mutable_header()->set_alpha_left_out(alpha_left_out);
  const size_t row = alpha_left_out ? 18 : 24;
  input.messages = {opened.SerializeAsString(), image.SerializeAsString(), band(0, 3 * row), band(3, row)};
  for (const v1::StreamResponse& message : {stream_header(1, 10), part, part, failure, away}) {
    input.messages.push_back(message.SerializeAsString());
  }
  write_file(path, format_wire_input(input));
}

// A session without images: every result is a header with a state.
void write_metered_session(const std::string& path) {
  WireInput input{.reader = WireInput::Reader::kSession, .metered = true, .width = 3, .height = 4};
  v1::StreamResponse message;
  message.mutable_opened()->set_session("fuzz");
  input.messages = {message.SerializeAsString()};
  for (uint64_t i = 0; i < kSessionFrames; ++i) {
    message = stream_header(i, 0);
    message.mutable_header()->set_encoding(v1::ENCODING_NONE);
    message.mutable_header()->set_exposure(kGivenExposure);
    message.mutable_header()->mutable_state()->set_sequence(i);
    input.messages.push_back(message.SerializeAsString());
  }
  write_file(path, format_wire_input(input));
}

// The open message of a session that continues after a state.
void write_open_with_state(const std::string& path) {
  v1::StreamRequest request;
  v1::StreamOpen& open = *request.mutable_open();
  open.set_session("fuzz");
  open.set_cut_threshold_ev(1);
  open.set_encoding(v1::ENCODING_NONE);
  open.set_return_state(true);
  open.mutable_state()->set_sequence(7);
  open.mutable_state()->set_media_time_ns(291666667);
  open.mutable_state()->set_exposure(0.3);
  open.mutable_state()->set_target(0.25);
  open.mutable_state()->set_cut_pending(true);
  for (int i = 0; i < 64; ++i) open.mutable_state()->add_picture(static_cast<float>(i) / 8);
  WireInput input;
  input.messages = {request.SerializeAsString()};
  write_file(path, format_wire_input(input));
}

// A panorama of 4 x 2 pixels, a bake of it, and a view with a sphere.
void write_environment(const std::string& folder) {
  v1::PutEnvironmentRequest put;
  v1::EnvironmentStart& start = *put.mutable_start();
  start.set_width(4);
  start.set_height(2);
  start.set_format(v1::PIXEL_FORMAT_RGB9E5);
  start.set_input_primaries(v1::PRIMARIES_REC2020);
  start.set_bad_values(v1::BAD_VALUES_REJECT);
  WireInput input;
  input.messages = {put.SerializeAsString(), band(0, 16), band(1, 16)};
  write_file(folder + "/put_environment", format_wire_input(input));

  v1::BakeEnvironmentRequest bake;
  bake.set_id(std::string(64, 'a'));
  bake.set_size(32);
  bake.set_levels(1);
  bake.set_roughness_mapping(v1::ROUGHNESS_MAPPING_PERCEPTUAL);
  bake.set_rotation_deg(90);
  bake.set_format(v1::PIXEL_FORMAT_RGBA16F);
  bake.set_tier("draft");
  input.messages = {bake.SerializeAsString()};
  write_file(folder + "/bake", format_wire_input(input));

  v1::RenderRequest render;
  v1::FrameHeader& frame = *render.mutable_start()->mutable_frame();
  frame.set_width(3);
  frame.set_height(4);
  v1::View& view = *frame.mutable_view();
  view.set_environment(std::string(64, 'a'));
  view.set_rotation_deg(10);
  view.set_samples(16);
  view.mutable_camera()->set_fov_deg(90);
  view.mutable_camera()->mutable_orientation()->set_w(1);
  view.mutable_camera()->mutable_position()->set_z(5);
  v1::Sphere& sphere = *view.add_objects();
  sphere.mutable_centre()->set_x(2);
  sphere.set_radius(0.5);
  sphere.mutable_base_color()->set_y(0.5);
  sphere.set_metallic(1);
  sphere.set_roughness(0.25);
  sphere.set_fixed_to_camera(true);
  input.messages = {render.SerializeAsString()};
  write_file(folder + "/view", format_wire_input(input));
}

}  // namespace

void write_wire_seeds(const std::string& folder) {
  for (const bool all_fields : {false, true}) {
    const std::string path = folder + (all_fields ? "/all_" : "/plain_");
    write_request(path + "rgba16f", v1::PIXEL_FORMAT_RGBA16F, 8, all_fields);
    write_request(path + "rgba32f", v1::PIXEL_FORMAT_RGBA32F, 16, all_fields);
    write_request(path + "rgb9e5", v1::PIXEL_FORMAT_RGB9E5, 4, all_fields);
    write_request(path + "rgb16f", v1::PIXEL_FORMAT_RGB16F, 6, all_fields);
    write_request(path + "rgb32f", v1::PIXEL_FORMAT_RGB32F, 12, all_fields);
  }
  write_response(folder + "/response_rgba8", v1::OUTPUT_FORMAT_RGBA8, 4, false);
  write_response(folder + "/response_rgba16", v1::OUTPUT_FORMAT_RGBA16, 8, false);
  write_response(folder + "/response_rgba16f", v1::OUTPUT_FORMAT_RGBA16F, 8, true);
  write_session(folder + "/session", false);
  write_session(folder + "/session_without_alpha", true);
  write_metered_session(folder + "/metered_session");
  write_open_with_state(folder + "/open_with_state");
  write_environment(folder);
}

}  // namespace candela
