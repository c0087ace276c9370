// The messages of one result: a header, the image in bands or as parts of a file, and its error map if there
// is one.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "candela/v1/render.pb.h"
#include "server/schedule/render_loop.h"
#include "server/session/render_start.h"

namespace candela {

// Whether the image's bands leave out its alpha.
bool leaves_out_alpha(const Frame& frame, const WireLayout& layout, const FrameReport& report);

// `device` is the name of the Vulkan device. The frame's memory may be gone.
v1::ResultHeader result_header(const Frame& frame, const WireLayout& layout, const RenderedFrame& rendered,
                               const std::string& device);

// Appends the times of stages.
void add_stages(const std::vector<StageTime>& times,
                google::protobuf::RepeatedPtrField<v1::StageTime>& stages);

// The answer for a frame that was only metered, with its histogram. `previous` is the exposure to adapt from,
// and `given` the frame's own.
v1::MeterResponse meter_response(const RenderedFrame& metered, const Settings& settings,
                                 const std::optional<PreviousExposure>& previous,
                                 std::optional<double> given);

// Not thread-safe.
class ResultWriter {
 public:
  // Sends `header` and then the image of `frame`, which has been rendered. `rgb`: without its alpha.
  ResultWriter(std::shared_ptr<const Frame> frame, grpc::ByteBuffer header, bool rgb);
  // Sends `header` and then `file`, the encoded image of a session's frame; empty: no image.
  ResultWriter(std::shared_ptr<const std::string> file, grpc::ByteBuffer header);

  // Puts the next message into `message`. Returns false if there is none. If the rows are contiguous in
  // memory, bands refer to them without a copy and keep the frame alive until gRPC, or a client in this
  // process, has released the message.
  bool next(grpc::ByteBuffer& message);

 private:
  grpc::Slice rows(uint32_t first, uint32_t count) const;
  grpc::Slice refer_to(const void* bytes, uint64_t count) const;

  bool next_part(grpc::ByteBuffer& message);

  // One of the two is set.
  const std::shared_ptr<const Frame> frame_;
  const std::shared_ptr<const std::string> file_;
  const bool rgb_ = false;
  const uint64_t row_bytes_ = 0;  // of what is sent
  grpc::ByteBuffer header_;
  bool header_sent_ = false;
  uint32_t next_row_ = 0;
  uint32_t next_map_row_ = 0;
  size_t next_byte_ = 0;
};

}  // namespace candela
