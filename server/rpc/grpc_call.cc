#include "server/rpc/grpc_call.h"

#include <string>

#include "server/access/client_identity.h"

namespace candela {
namespace {

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

}  // namespace

GrpcReactor* serve_call(grpc::CallbackServerContext* context,
                        absl::FunctionRef<std::shared_ptr<ServerCall>(CallTransport&)> begin) {
  return new GrpcCall(*context, begin);
}

}  // namespace candela
