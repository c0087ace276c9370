#include "server/rpc/result_writer.h"

#include <grpcpp/support/slice.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

void let_go(void* holder) { delete static_cast<std::shared_ptr<const Frame>*>(holder); }

grpc::ByteBuffer serialize(const v1::RenderResponse& response) {
  const grpc::Slice bytes(response.SerializeAsString());
  return grpc::ByteBuffer(&bytes, 1);
}

}  // namespace

v1::ResultHeader result_header(const Frame& frame, const RenderedFrame& rendered, const std::string& device) {
  const FrameReport& report = rendered.report;
  v1::ResultHeader header;
  header.set_sequence(frame.moment.sequence);
  header.set_width(frame.memory.desc().width);
  header.set_height(frame.memory.desc().height);
  header.set_format(static_cast<v1::OutputFormat>(frame.settings.output_format));
  v1::FrameStatistics& statistics = *header.mutable_statistics();
  statistics.set_mean_log2_luminance(report.stats.mean_log2_luminance);
  statistics.set_min_luminance(report.stats.min_luminance);
  statistics.set_max_luminance(report.stats.max_luminance);
  statistics.set_nan_components(report.stats.nan_components);
  statistics.set_infinite_components(report.stats.infinite_components);
  statistics.set_negative_components(report.stats.negative_components);
  header.set_exposure(report.exposure);
  header.set_target(report.target);
  header.set_prescale(frame.settings.prescale);
  for (const std::string& line : report.plan.words) header.add_plan(line);
  v1::StageTime& queue = *header.add_stages();
  queue.set_name("queue");
  queue.set_ns(static_cast<uint64_t>(absl::ToInt64Nanoseconds(rendered.queued)));
  for (const StageTime& stage : report.stages) {
    v1::StageTime& time = *header.add_stages();
    time.set_name(stage.name);
    time.set_ns(stage.ns);
  }
  header.set_tier(frame.settings.tier);
  header.set_device(device);
  return header;
}

ResultWriter::ResultWriter(std::shared_ptr<const Frame> frame, const v1::ResultHeader& header)
    : frame_(std::move(frame)),
      row_bytes_(uint64_t{frame_->memory.desc().width} * bytes_per_pixel(frame_->settings.output_format)) {
  v1::RenderResponse response;
  *response.mutable_header() = header;
  header_ = serialize(response);
}

bool ResultWriter::next(grpc::ByteBuffer& message) {
  if (!header_sent_) {
    header_sent_ = true;
    message.Swap(&header_);
    return true;
  }
  const uint32_t left = frame_->memory.desc().height - next_row_;
  if (left == 0) return false;
  const auto count = static_cast<uint32_t>(std::min<uint64_t>(left, v1::kMaxBandBytes / row_bytes_));
  message = v1::make_band(next_row_, rows(next_row_, count));
  next_row_ += count;
  return true;
}

grpc::Slice ResultWriter::rows(uint32_t first, uint32_t count) const {
  const uint64_t bytes = row_bytes_ * count;
  if (frame_->memory.output_contiguous()) {
    void* pixels = const_cast<std::byte*>(frame_->memory.output_row(first).data());  // gRPC only reads it
    return grpc::Slice(pixels, bytes, let_go, new std::shared_ptr<const Frame>(frame_));
  }
  grpc::Slice copy(bytes);
  auto* to = const_cast<uint8_t*>(copy.begin());  // ours until it is sent
  for (uint32_t y = first; y < first + count; ++y, to += row_bytes_) {
    std::memcpy(to, frame_->memory.output_row(y).data(), row_bytes_);
  }
  return copy;
}

}  // namespace candela
