#include "server/rpc/result_writer.h"

#include <grpcpp/support/slice.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "server/encode/image_file.h"
#include "server/render/plan/exposure.h"

namespace candela {
namespace {

void release_frame(void* holder) { delete static_cast<std::shared_ptr<const Frame>*>(holder); }

uint32_t rows_of_a_band(uint32_t left, uint64_t row_bytes) {
  return static_cast<uint32_t>(std::min<uint64_t>(left, v1::kMaxBandBytes / row_bytes));
}

v1::Verification verification(const Verification& ours) {
  v1::Verification message;
  message.set_max_error_codes(ours.max_codes);
  message.set_p999_error_codes(ours.p999_codes);
  message.set_mean_error_codes(ours.mean_codes);
  message.set_worst_x(ours.worst_x);
  message.set_worst_y(ours.worst_y);
  message.set_differing_components(static_cast<double>(ours.differing) /
                                   static_cast<double>(ours.components));
  message.set_meter_error_ev(ours.meter_error_ev);
  message.set_bloom_error(ours.bloom_error);
  return message;
}

v1::FrameStatistics statistics(const FrameStats& stats) {
  v1::FrameStatistics message;
  message.set_mean_log2_luminance(stats.mean_log2_luminance);
  message.set_min_luminance(stats.min_luminance);
  message.set_max_luminance(stats.max_luminance);
  message.set_nan_components(stats.nan_components);
  message.set_infinite_components(stats.infinite_components);
  message.set_clamped_components(stats.clamped_components);
  message.set_negative_components(stats.negative_components);
  message.set_absent_pixels(stats.absent_pixels);
  return message;
}

void add_stages(const RenderedFrame& rendered, google::protobuf::RepeatedPtrField<v1::StageTime>& stages) {
  v1::StageTime& queue = *stages.Add();
  queue.set_name("queue");
  queue.set_ns(static_cast<uint64_t>(absl::ToInt64Nanoseconds(rendered.queued)));
  add_stages(rendered.report.stages, stages);
}

}  // namespace

void add_stages(const std::vector<StageTime>& times,
                google::protobuf::RepeatedPtrField<v1::StageTime>& stages) {
  for (const StageTime& stage : times) {
    v1::StageTime& time = *stages.Add();
    time.set_name(stage.name);
    time.set_ns(stage.ns);
  }
}

v1::MeterResponse meter_response(const RenderedFrame& metered, const Settings& settings,
                                 const std::optional<PreviousExposure>& previous,
                                 std::optional<double> given) {
  const FrameStats& stats = metered.report.stats;
  const Exposed exposed = expose(settings->exposure(), previous, stats.metered_mean(), given);
  v1::MeterResponse response;
  *response.mutable_statistics() = statistics(stats);
  response.set_exposure(exposed.exposure);
  response.set_target(exposed.target);
  response.set_target_before_limits(exposed.target_before_limits);
  *response.mutable_histogram() = {stats.histogram.begin(), stats.histogram.end()};
  response.set_histogram_first_ev(kHistogramFirstEv);
  response.set_histogram_bins_per_ev(kHistogramBinsPerEv);
  add_stages(metered, *response.mutable_stages());
  return response;
}

bool leaves_out_alpha(const Frame& frame, const WireLayout& layout, const FrameReport& report) {
  const bool opaque = (report.plan.resolve.opaque || !keeps_alpha(*frame.settings)) && !report.plan.gain;
  return layout.may_leave_out_alpha && opaque && !frame.image_in_memory;
}

v1::ResultHeader result_header(const Frame& frame, const WireLayout& layout, const RenderedFrame& rendered,
                               const std::string& device) {
  const FrameReport& report = rendered.report;
  v1::ResultHeader header;
  header.set_sequence(frame.sequence);
  const ImageSize image = image_size(*frame.settings, layout.desc);
  header.set_width(image.width);
  header.set_height(image.height);
  header.set_format(frame.settings->output_format());
  *header.mutable_statistics() = statistics(report.stats);
  header.set_exposure(report.exposure);
  header.set_target(report.target);
  header.set_target_before_limits(report.target_before_limits);
  header.set_gamut_cut_components(report.gamut_cut_components);
  if (report.shown) {
    header.set_max_light_nits(report.shown->largest * frame.settings->peak_nits());
    header.set_mean_light_nits(report.shown->mean * frame.settings->peak_nits());
  }
  if (report.plan.gain) header.set_gain_map_max_log2(report.plan.gain->max_log2());
  header.set_prescale(frame.settings->prescale());
  for (const std::string& line : report.plan.words) header.add_plan(line);
  add_stages(rendered, *header.mutable_stages());
  header.set_tier(report.tier.empty() ? frame.settings->tier() : report.tier);  // empty if nothing was drawn
  header.set_tier_reason(report.tier_reason);
  if (report.error_bound) header.set_error_bound_codes(*report.error_bound);
  header.set_device(device);
  header.set_image_in_memory(frame.image_in_memory);
  if (report.verification) {
    *header.mutable_verify() = verification(report.verification->rounded);
    *header.mutable_verify_unrounded() = verification(report.verification->unrounded);
  }
  return header;
}

ResultWriter::ResultWriter(std::shared_ptr<const Frame> frame, grpc::ByteBuffer header, bool rgb)
    : frame_(std::move(frame)),
      rgb_(rgb),
      row_bytes_(uint64_t{frame_->memory.image().width} * bytes_per_pixel(frame_->settings->output_format()) /
                 4 * (rgb ? 3 : 4)),
      header_(std::move(header)) {}

ResultWriter::ResultWriter(std::shared_ptr<const std::string> file, grpc::ByteBuffer header)
    : file_(std::move(file)), header_(std::move(header)) {}

bool ResultWriter::next_part(grpc::ByteBuffer& message) {
  if (next_byte_ == file_->size()) return false;
  const size_t count = std::min<size_t>(file_->size() - next_byte_, v1::kMaxBandBytes);
  v1::StreamResponse response;
  response.mutable_encoded()->set_data(file_->data() + next_byte_, count);
  message = v1::pack(response);
  next_byte_ += count;
  return true;
}

bool ResultWriter::next(grpc::ByteBuffer& message) {
  if (!header_sent_) {
    header_sent_ = true;
    message.Swap(&header_);
    return true;
  }
  if (file_) return next_part(message);
  const uint32_t height = frame_->memory.image().height;
  if (next_row_ < height && !frame_->image_in_memory) {
    const uint32_t count = rows_of_a_band(height - next_row_, row_bytes_);
    message = v1::make_band(v1::kImageBand, next_row_, rows(next_row_, count));
    next_row_ += count;
    return true;
  }
  const uint64_t map_row_bytes = frame_->memory.error_map_row(0).size_bytes();
  if (map_row_bytes == 0 || next_map_row_ == height) return false;
  const uint32_t count = rows_of_a_band(height - next_map_row_, map_row_bytes);
  const void* map = frame_->memory.error_map_row(next_map_row_).data();
  message = v1::make_band(v1::kErrorMapBand, next_map_row_, refer_to(map, map_row_bytes * count));
  next_map_row_ += count;
  return true;
}

grpc::Slice ResultWriter::refer_to(const void* bytes, uint64_t count) const {
  // The const_cast is safe because gRPC only reads the bytes.
  return grpc::Slice(const_cast<void*>(bytes), count, release_frame,
                     new std::shared_ptr<const Frame>(frame_));
}

grpc::Slice ResultWriter::rows(uint32_t first, uint32_t count) const {
  const uint64_t bytes = row_bytes_ * count;
  if (frame_->memory.output_contiguous() && !rgb_)
    return refer_to(frame_->memory.output_row(first).data(), bytes);
  grpc::Slice copy(bytes);
  auto* to = const_cast<uint8_t*>(copy.begin());  // not shared until it is sent
  for (uint32_t y = first; y < first + count; ++y, to += row_bytes_) {
    const std::span<const std::byte> row = frame_->memory.output_row(y);
    if (rgb_) {
      v1::leave_out_alpha(frame_->settings->output_format(), row,
                          {reinterpret_cast<std::byte*>(to), row_bytes_});
    } else {
      std::memcpy(to, row.data(), row_bytes_);
    }
  }
  return copy;
}

}  // namespace candela
