#include "server/rpc/status.h"

#include <google/protobuf/any.pb.h>
#include <google/protobuf/duration.pb.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <string>

namespace candela {
namespace {

constexpr size_t kMaxMessageBytes = 1024;
constexpr int kRetrySeconds = 1;

constexpr uint32_t kLengthDelimited = 2;

void write_bytes(google::protobuf::io::CodedOutputStream& out, uint32_t field, const std::string& value) {
  out.WriteTag(field << 3 | kLengthDelimited);
  out.WriteVarint32(static_cast<uint32_t>(value.size()));
  out.WriteString(value);
}

// Serialises google.rpc.RetryInfo: retry_delay = 1.
std::string retry_info() {
  google::protobuf::Duration delay;
  delay.set_seconds(kRetrySeconds);
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream out(&stream);
  write_bytes(out, 1, delay.SerializeAsString());
  out.Trim();
  return bytes;
}

// Serialises google.rpc.Status: code = 1, message = 2, details = 3. Debian does not package these protos.
std::string rpc_status(int code, const std::string& message) {
  google::protobuf::Any detail;
  detail.set_type_url("type.googleapis.com/google.rpc.RetryInfo");
  detail.set_value(retry_info());
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream out(&stream);
  out.WriteTag(1 << 3);
  out.WriteVarint32(static_cast<uint32_t>(code));
  write_bytes(out, 2, message);
  write_bytes(out, 3, detail.SerializeAsString());
  out.Trim();
  return bytes;
}

}  // namespace

grpc::Status to_grpc(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const auto code =
      static_cast<grpc::StatusCode>(status.code());  // both enums have the same numbers by definition
  const std::string message(status.message().substr(0, kMaxMessageBytes));
  if (!absl::IsUnavailable(status)) return grpc::Status(code, message);
  return grpc::Status(code, message, rpc_status(code, message));
}

}  // namespace candela
