// The messages of a result: a header, then the image, in bands or as parts of a file, then its error map
// where there is one.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <memory>
#include <string>

#include "candela/v1/render.pb.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// `device` is the device's own name.
v1::ResultHeader result_header(const Frame& frame, const RenderedFrame& rendered, const std::string& device);

// Of a frame whose Work was kMeter, with its histogram.
v1::MeterResponse meter_response(const Frame& frame, const RenderedFrame& metered);

// One thread at a time.
class ResultWriter {
 public:
  // `frame` has been rendered; `header` is the message that comes first.
  ResultWriter(std::shared_ptr<const Frame> frame, grpc::ByteBuffer header);
  // Of a session's result whose image is `file`.
  ResultWriter(std::shared_ptr<const std::string> file, grpc::ByteBuffer header);

  // The next message; false when there is none. Bands point into the frame's memory where its rows follow
  // each other, and hold on to the frame until gRPC, or a client in this process, has let go of the message.
  bool next(grpc::ByteBuffer& message);

 private:
  grpc::Slice rows(uint32_t first, uint32_t count) const;
  grpc::Slice refer_to(const void* bytes, uint64_t count) const;

  bool next_part(grpc::ByteBuffer& message);

  const std::shared_ptr<const Frame> frame_;  // or
  const std::shared_ptr<const std::string> file_;
  const uint64_t row_bytes_ = 0;
  grpc::ByteBuffer header_;
  bool header_sent_ = false;
  uint32_t next_row_ = 0;
  uint32_t next_map_row_ = 0;
  size_t next_byte_ = 0;
};

}  // namespace candela
