#include <gtest/gtest.h>

#include <string>

#include "server/rpc/status.h"

namespace candela {
namespace {

TEST(RpcStatus, KeepsEveryCodeAndMessage) {
  for (int code = 0; code <= 16; ++code) {
    const grpc::Status status = to_grpc(absl::Status(static_cast<absl::StatusCode>(code), "why"));
    EXPECT_EQ(static_cast<int>(status.error_code()), code);
    EXPECT_EQ(status.error_message(), code == 0 ? "" : "why");
  }
}

// A longer message would not fit into HTTP/2's headers, and the client would see another error.
TEST(RpcStatus, CutsLongMessages) {
  EXPECT_EQ(to_grpc(absl::InvalidArgumentError(std::string(50000, 'x'))).error_message().size(), 1024u);
}

TEST(RpcStatus, UnavailableSaysWhenToTryAgain) {
  // google.rpc.Status { code: 14 message: "full" details { RetryInfo { retry_delay { seconds: 1 } } } }
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string any =
      "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12\x04\x0a\x02\x08\x01";
  const std::string expected =
      "\x08\x0e\x12\x04"
      "full\x1a" +
      std::string(1, static_cast<char>(any.size())) + any;
  EXPECT_EQ(to_grpc(absl::UnavailableError("full")).error_details(), expected);
  EXPECT_EQ(to_grpc(absl::InternalError("broken")).error_details(), "");
}

}  // namespace
}  // namespace candela
