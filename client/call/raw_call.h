// A gRPC call of raw messages, driven by the thread that owns it.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <string>

#include "absl/time/time.h"

namespace candela {

// Every member waits until its operation is done. A result of false means that the call is over, and finish()
// says why.
class RawCall {
 public:
  // `method` is "/package.Service/Method".
  RawCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method, absl::Time deadline);
  // Cancels the call unless it was finished.
  ~RawCall();
  RawCall(const RawCall&) = delete;
  RawCall& operator=(const RawCall&) = delete;

  bool write(const grpc::ByteBuffer& message);
  bool half_close();
  bool read(grpc::ByteBuffer& message);
  // Returns how the call ended. To be called once, after the last read.
  grpc::Status finish();

  // True if the server was reached: a message was sent to it, or it refused the call with details, which may
  // come before the first message is sent. Final after the call's end.
  bool connected() const { return connected_; }

 private:
  bool wait();

  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream_;
  bool started_ = false;
  bool connected_ = false;
  bool finished_ = false;
};

}  // namespace candela
