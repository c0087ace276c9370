// candela.v1.RenderService, as gRPC calls it.
#pragma once

#include <functional>
#include <string>

#include "absl/time/time.h"
#include "candela/v1/render.grpc.pb.h"
#include "server/rpc/backend.h"

namespace candela {

// Pixels come and go as raw bytes; everything else as the generated classes.
class RenderService final
    : public v1::RenderService::WithRawCallbackMethod_Render<v1::RenderService::WithRawCallbackMethod_Stream<
          v1::RenderService::WithCallbackMethod_GetServerInfo<v1::RenderService::Service>>> {
 public:
  // `info` holds what does not change while the server runs; `pool` gives the counters of the texture pool.
  // `backend` outlives the service.
  RenderService(Backend& backend, std::function<PoolCounters()> pool, v1::GetServerInfoResponse info);

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Render(
      grpc::CallbackServerContext* context) override;

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Stream(
      grpc::CallbackServerContext* context) override;

  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context,
                                          const v1::GetServerInfoRequest* request,
                                          v1::GetServerInfoResponse* response) override;

 private:
  Backend& backend_;
  const std::function<PoolCounters()> pool_;
  const v1::GetServerInfoResponse info_;
  const absl::Time started_;
};

}  // namespace candela
