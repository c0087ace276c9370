#include "server/rpc/render_service.h"

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "server/access/client_identity.h"
#include "server/render/self_test.h"
#include "server/rpc/environment_calls.h"
#include "server/rpc/render_call.h"
#include "server/rpc/server_call.h"
#include "server/rpc/status.h"
#include "server/rpc/stream_call.h"

namespace candela {
namespace {

// The transport that gRPC is.

using GrpcReactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;

// Owns itself until gRPC calls OnDone, and keeps its call as long.
class GrpcCall final : public GrpcReactor, public CallTransport {
 public:
  GrpcCall(grpc::CallbackServerContext& context,
           absl::FunctionRef<std::shared_ptr<ServerCall>(CallTransport&)> begin)
      : context_(context), call_(begin(*this)) {}

  void start_read(grpc::ByteBuffer* message) override { StartRead(message); }
  void start_write(const grpc::ByteBuffer* message) override { StartWrite(message); }
  void finish(const grpc::Status& status) override { Finish(status); }
  void cancel() override { context_.TryCancel(); }
  bool is_cancelled() const override { return context_.IsCancelled(); }
  absl::Time deadline() const override { return absl::FromChrono(context_.deadline()); }
  std::string peer() const override { return client_address(context_); }
  bool straight_from_this_host() const override { return is_straight_from_this_host(context_); }
  std::string identity(bool tokens) const override { return client_identity(context_, tokens); }

  void OnReadDone(bool ok) override { call_->on_read_done(ok); }
  void OnWriteDone(bool ok) override { call_->on_write_done(ok); }
  void OnCancel() override { call_->on_cancel(); }
  void OnDone() override {
    call_->on_done();
    delete this;
  }

 private:
  grpc::CallbackServerContext& context_;
  const std::shared_ptr<ServerCall> call_;  // last: it begins with the rest of this object
};

// Begins the call that `begin` makes for its transport, and returns what gRPC's handler has to return. gRPC's
// reactions reach the call from then on.
GrpcReactor* serve_call(grpc::CallbackServerContext* context,
                        absl::FunctionRef<std::shared_ptr<ServerCall>(CallTransport&)> begin) {
  return new GrpcCall(*context, begin);
}

// The indices of rpcs in render.proto. On the wire, a call with one request or one answer is a stream with
// one message, and these are handled as streams. The generated class has no raw handler for that.
constexpr int kMeterIndex = 2;
constexpr int kPutEnvironmentIndex = 4;
constexpr int kBakeEnvironmentIndex = 6;

using RawHandler = grpc::internal::CallbackBidiHandler<grpc::ByteBuffer, grpc::ByteBuffer>;

}  // namespace

RenderService::RenderService(ServiceState& state, std::function<PoolCounters()> pool,
                             v1::GetServerInfoResponse info)
    : state_(state), pool_(std::move(pool)), info_(std::move(info)), started_(state.clock.now()) {
  MarkMethodRawCallback(kMeterIndex, new RawHandler([&state](grpc::CallbackServerContext* context) {
                          return serve_call(context, [&](CallTransport& transport) {
                            return RenderCall::begin(transport, state, Work::kMeter);
                          });
                        }));
  MarkMethodRawCallback(kPutEnvironmentIndex, new RawHandler([&state](grpc::CallbackServerContext* context) {
                          return serve_call(context, [&](CallTransport& transport) {
                            return PutEnvironmentCall::begin(transport, state);
                          });
                        }));
  // Says that gRPC does not read the one request itself.
  MarkMethodStreamed(kBakeEnvironmentIndex, nullptr);
  MarkMethodRawCallback(kBakeEnvironmentIndex, new RawHandler([&state](grpc::CallbackServerContext* context) {
                          return serve_call(context, [&](CallTransport& transport) {
                            return BakeEnvironmentCall::begin(transport, state);
                          });
                        }));
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* RenderService::Render(
    grpc::CallbackServerContext* context) {
  return serve_call(
      context, [&](CallTransport& transport) { return RenderCall::begin(transport, state_, Work::kRender); });
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* RenderService::Stream(
    grpc::CallbackServerContext* context) {
  return serve_call(context, [&](CallTransport& transport) { return StreamCall::begin(transport, state_); });
}

grpc::ServerUnaryReactor* RenderService::GetServerInfo(grpc::CallbackServerContext* context,
                                                       const v1::GetServerInfoRequest*,
                                                       v1::GetServerInfoResponse* response) {
  *response = info_;
  const PoolCounters counters = pool_();
  v1::PoolInfo& pool = *response->mutable_pool();
  pool.set_hits(counters.hits);
  pool.set_misses(counters.misses);
  pool.set_bytes_in_use(counters.bytes_in_use);
  pool.set_bytes_idle(counters.bytes_idle);
  pool.set_bytes_peak(counters.bytes_peak);
  response->set_uptime_seconds(static_cast<uint64_t>(absl::ToInt64Seconds(state_.clock.now() - started_)));
  response->set_sessions(state_.session_gate.places_taken());
  response->set_frames_rendered(state_.rendering.frames_rendered);
  response->set_shared_memory(state_.regions.offered() && is_straight_from_this_host(*context));
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

grpc::ServerUnaryReactor* RenderService::GetEnvironment(grpc::CallbackServerContext* context,
                                                        const v1::GetEnvironmentRequest* request,
                                                        v1::Environment* response) {
  absl::StatusOr<EnvironmentUse> found =
      state_.environments.find("id", request->id(), *state_.rendering.renderer());
  if (found.ok()) {
    *response = (*found)->facts;
    response->set_had_it(true);
    found->reset();  // nobody uses it any more when the client has its answer
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(to_grpc(found.status()));
  return reactor;
}

grpc::ServerUnaryReactor* RenderService::DropEnvironment(grpc::CallbackServerContext* context,
                                                         const v1::DropEnvironmentRequest* request,
                                                         v1::DropEnvironmentResponse* response) {
  const absl::StatusOr<bool> in_use = state_.environments.drop(request->id(), *state_.rendering.renderer());
  if (in_use.ok()) response->set_in_use(*in_use);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(to_grpc(in_use.status()));
  return reactor;
}

}  // namespace candela
