// The gRPC service candela.v1.RenderService.
#pragma once

#include <functional>
#include <string>

#include "absl/time/time.h"
#include "candela/v1/render.grpc.pb.h"
#include "server/rpc/service_state.h"

namespace candela {

// Calls with pixels use raw bytes. The others use the generated classes.
class RenderService final
    : public v1::RenderService::WithRawCallbackMethod_Render<
          v1::RenderService::WithRawCallbackMethod_Stream<v1::RenderService::WithCallbackMethod_GetServerInfo<
              v1::RenderService::WithCallbackMethod_GetEnvironment<
                  v1::RenderService::WithCallbackMethod_DropEnvironment<v1::RenderService::Service>>>>> {
 public:
  // `info` holds the answers that do not change while the server runs. `pool` returns the counters of the
  // texture pool. `state` outlives the service.
  RenderService(ServiceState& state, std::function<PoolCounters()> pool, v1::GetServerInfoResponse info);

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Render(
      grpc::CallbackServerContext* context) override;

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Stream(
      grpc::CallbackServerContext* context) override;

  grpc::ServerUnaryReactor* GetServerInfo(grpc::CallbackServerContext* context,
                                          const v1::GetServerInfoRequest* request,
                                          v1::GetServerInfoResponse* response) override;

  grpc::ServerUnaryReactor* GetEnvironment(grpc::CallbackServerContext* context,
                                           const v1::GetEnvironmentRequest* request,
                                           v1::Environment* response) override;

  grpc::ServerUnaryReactor* DropEnvironment(grpc::CallbackServerContext* context,
                                            const v1::DropEnvironmentRequest* request,
                                            v1::DropEnvironmentResponse* response) override;

 private:
  ServiceState& state_;
  const std::function<PoolCounters()> pool_;
  const v1::GetServerInfoResponse info_;
  const absl::Time started_;
};

}  // namespace candela
