#include "server/rpc/render_service.h"

#include <grpcpp/support/server_callback.h>

#include <utility>

#include "server/render/self_test.h"
#include "server/rpc/render_call.h"
#include "server/rpc/stream_call.h"

namespace candela {

namespace {

// The index of `rpc Meter` in render.proto. On the wire, a call with one answer is a stream with one message,
// and RenderCall handles streams. The generated class has no raw handler for that.
constexpr int kMeterIndex = 2;

// The times of the tiers, as far as they are measured.
void add_times(const TierBenchmark& benchmark, v1::GetServerInfoResponse& info) {
  for (int i = 0; i < info.tiers_size(); ++i) {
    const Tier& tier = tiers()[static_cast<size_t>(i)];
    for (const MeasuredTime& time : benchmark.measured(tier, kUsualFormat, Settings())) {
      v1::TierTime& row = *info.mutable_tiers(i)->add_times();
      row.set_width(time.width);
      row.set_height(time.height);
      row.set_ms(time.ms);
    }
  }
}

}  // namespace

RenderService::RenderService(ServiceState& state, std::function<PoolCounters()> pool,
                             v1::GetServerInfoResponse info)
    : state_(state), pool_(std::move(pool)), info_(std::move(info)), started_(absl::Now()) {
  MarkMethodRawCallback(kMeterIndex,
                        new grpc::internal::CallbackBidiHandler<grpc::ByteBuffer, grpc::ByteBuffer>(
                            [&state](grpc::CallbackServerContext* context) {
                              return RenderCall::begin(context, state, Work::kMeter);
                            }));
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* RenderService::Render(
    grpc::CallbackServerContext* context) {
  return RenderCall::begin(context, state_, Work::kRender);
}

grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* RenderService::Stream(
    grpc::CallbackServerContext* context) {
  return StreamCall::begin(context, state_);
}

grpc::ServerUnaryReactor* RenderService::GetServerInfo(grpc::CallbackServerContext* context,
                                                       const v1::GetServerInfoRequest*,
                                                       v1::GetServerInfoResponse* response) {
  *response = info_;
  add_times(state_.rendering.tier_benchmark, *response);
  const PoolCounters counters = pool_();
  v1::PoolInfo& pool = *response->mutable_pool();
  pool.set_hits(counters.hits);
  pool.set_misses(counters.misses);
  pool.set_bytes_in_use(counters.bytes_in_use);
  pool.set_bytes_idle(counters.bytes_idle);
  pool.set_bytes_peak(counters.bytes_peak);
  response->set_uptime_seconds(static_cast<uint64_t>(absl::ToInt64Seconds(absl::Now() - started_)));
  response->set_sessions(state_.session_gate.inside());
  response->set_frames_rendered(state_.rendering.frames_rendered);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

}  // namespace candela
