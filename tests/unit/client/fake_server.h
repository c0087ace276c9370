// A server for the client's session that fails as a test tells it to.
#pragma once

#include <grpcpp/server_builder.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "candela/v1/render.grpc.pb.h"

namespace candela {

using Wire = grpc::ServerReaderWriter<v1::StreamResponse, v1::StreamRequest>;

// Answers each frame with an image of one value: 16 times the manual EV plus the sequence number. The resume
// token is the sequence number. Listens on a free TCP port while it exists.
class FakeServer : public v1::RenderService::Service {
 public:
  // Called with each frame's number before it is answered. A status other than OK ends the call with it, and
  // kEndsAsIfDone ends it with OK.
  using Fault = std::function<grpc::Status(uint64_t sequence, Wire& stream)>;
  static inline const grpc::Status kEndsAsIfDone{grpc::OUT_OF_RANGE, "as if done"};

  // Called with the number of opens before this one. A status other than OK refuses it.
  using OpenFault = std::function<grpc::Status(size_t opens)>;

  explicit FakeServer(Fault fault = nullptr, OpenFault open_fault = nullptr);
  ~FakeServer() override;

  std::string address() const;
  // The open messages so far.
  std::vector<v1::StreamOpen> opens();

  grpc::Status Stream(grpc::ServerContext* context, Wire* stream) override;

 private:
  const Fault fault_;
  const OpenFault open_fault_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
  std::mutex mutex_;
  std::vector<v1::StreamOpen> opens_;
};

}  // namespace candela
