// A server for the tests of a suite, and clients for it.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "candela/v1/render.grpc.pb.h"
#include "client/connection.h"
#include "server/server.h"
#include "tests/service/real_time.h"
#include "tests/support/scenes.h"

namespace candela::testing {

constexpr uint32_t kMaxCalls = 8;

// Frames take some times as long with a sanitizer. So do the timeouts that no frame may reach by itself.
#ifdef CANDELA_SANITIZED
constexpr int kSlower = 4;
#else
constexpr int kSlower = 1;
#endif

// A configuration with limits small enough to reach. It listens on a free port of 127.0.0.1.
Config test_config();

std::unique_ptr<Server> start_server(const Config& config);
std::unique_ptr<Server> start_server(const Config& config, Clock& clock, Timers& timers);

// Options for a frame's form on the wire.
v1::PixelFormat wire_format(v1::PixelFormat format);
FrameView view(const WireFrame& frame, uint64_t sequence = 0);
v1::RenderRequest start_of(const WireFrame& frame);
v1::RenderRequest band_of(const WireFrame& frame, uint32_t first_row, uint32_t rows);

// A call of Render through the generated classes that the test can abandon at any point.
struct OpenCall {
  explicit OpenCall(const std::shared_ptr<grpc::Channel>& channel,
                    const std::function<void(grpc::ClientContext&)>& prepare = {});
  bool write(const v1::RenderRequest& request) { return stream->Write(request); }
  // Reads what is still to come. Returns the call's status.
  grpc::Status finish();

  grpc::ClientContext context;
  std::unique_ptr<v1::RenderService::Stub> stub;
  std::unique_ptr<grpc::ClientReaderWriter<v1::RenderRequest, v1::RenderResponse>> stream;
};

// A channel with a separate connection. By default, channels to the same address share one connection and its
// flow control.
std::shared_ptr<grpc::Channel> own_channel(const std::string& address);

// Waits until the server's information meets the condition; false after a minute.
bool wait_until(const Connection& connection,
                const std::function<bool(const v1::GetServerInfoResponse&)>& is_so);
// Waits until no frame holds memory and no session is open; false after a minute.
bool wait_until_idle(const Connection& connection);
// Waits until a frame holds memory; false after a minute.
bool wait_until_in_use(const Connection& connection);

// Every test runs over the in-process channel and over TCP, against one server for the suite.
class ServiceTest : public ::testing::TestWithParam<bool> {
 protected:
  static void SetUpTestSuite();
  static void TearDownTestSuite();
  void TearDown() override;

  static std::shared_ptr<grpc::Channel> channel();
  static Connection connection() { return Connection(channel()); }
  static v1::PoolInfo pool();

  static Server& server() { return *server_; }

 private:
  static std::unique_ptr<Server> server_;
};

std::string transport_name(const ::testing::TestParamInfo<bool>& info);

// Reads a server's metrics port.

// Returns the whole answer to GET `path`; empty if nobody listens.
std::string get(const std::string& address, const std::string& path);

// Maps `name{label="value"}` to its value.
std::map<std::string, double> scrape(const Server& server);

}  // namespace candela::testing
