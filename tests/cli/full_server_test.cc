// The command with servers that are too busy for its work, or are lost with it: it waits and repeats within
// --resume.
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>

#include "candela/v1/render.grpc.pb.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"

namespace candela {
namespace {

using RenderWire = grpc::ServerReaderWriter<v1::RenderResponse, v1::RenderRequest>;
using StreamWire = grpc::ServerReaderWriter<v1::StreamResponse, v1::StreamRequest>;

// Refuses the first calls as candelad does: UNAVAILABLE, and a RetryInfo of half a second. With `late` it
// first reads the whole frame, as if the device were lost. Then it answers with a grey image.
class FullServer : public v1::RenderService::Service {
 public:
  FullServer(int refusals, bool late) : left_(refusals), late_(late) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }
  ~FullServer() override { server_->Shutdown(std::chrono::system_clock::now()); }

  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  int calls() const { return calls_; }

  grpc::Status GetServerInfo(grpc::ServerContext*, const v1::GetServerInfoRequest*,
                             v1::GetServerInfoResponse* info) override {
    info->mutable_limits()->set_max_dimension(1024);
    info->mutable_limits()->set_max_frame_bytes(1 << 20);
    return grpc::Status::OK;
  }

  grpc::Status Render(grpc::ServerContext*, RenderWire* stream) override {
    ++calls_;
    const bool refuse = left_-- > 0;
    if (refuse && !late_) return full();
    v1::RenderRequest request;
    size_t bytes = 0;
    while (stream->Read(&request)) bytes += request.band().pixels().size();
    if (refuse) return full();
    v1::RenderResponse response;
    v1::ResultHeader& header = *response.mutable_header();
    header.set_width(31);
    header.set_height(17);
    header.set_format(v1::OUTPUT_FORMAT_RGBA8);
    header.set_exposure(1);
    stream->Write(response);
    response.mutable_band()->set_pixels(std::string(31 * 17 * 4, bytes == 31 * 17 * 8 ? 'x' : '?'));
    stream->Write(response);
    return grpc::Status::OK;
  }

  grpc::Status Meter(grpc::ServerContext*, grpc::ServerReader<v1::RenderRequest>* reader,
                     v1::MeterResponse* response) override {
    ++calls_;
    if (left_-- > 0) return full();
    v1::RenderRequest request;
    while (reader->Read(&request)) continue;
    response->set_exposure(1);
    response->set_target(1);
    return grpc::Status::OK;
  }

  grpc::Status Stream(grpc::ServerContext*, StreamWire*) override {
    ++calls_;
    return full();
  }

 private:
  static grpc::Status full() {
    const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
    const std::string info("\x0a\x06\x10\x80\xca\xb5\xee\x01", 8);
    const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                            std::string(1, static_cast<char>(info.size())) + info;
    const std::string details = "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any;
    return {grpc::UNAVAILABLE, "server has 3 calls, which is its limit; try again soon", details};
  }

  std::atomic<int> left_;
  std::atomic<int> calls_ = 0;
  const bool late_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

class FullServerTest : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(FullServerTest, ASingleImageWaitsForItAndSaysSoOnce) {
  for (const bool late : {false, true}) {
    FullServer server(2, late);
    const Outcome outcome = candela({"render", in_, out_, "--server", server.address()});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(server.calls(), 3);
    EXPECT_EQ(outcome.err,
              "note: " + server.address() +
                  ": server has 3 calls, which is its limit; waiting for up to 30s (--resume)\n");
    EXPECT_EQ(png_facts(out_).width, 31u);
  }
  FullServer server(2, false);
  EXPECT_EQ(candela({"meter", in_, "-q", "--server", server.address()}).code, 0);
  EXPECT_EQ(server.calls(), 3);
}

TEST_F(FullServerTest, AnotherServerIsAskedAtOnce) {
  FullServer full(100, false), free(0, false);
  const Outcome outcome = candela({"render", in_, out_, "--server", full.address() + "," + free.address()});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(outcome.err, "");
  EXPECT_EQ(full.calls(), 1);
}

TEST_F(FullServerTest, ItGivesUpAtTheLimitWithOneLine) {
  FullServer server(1000, false);
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"render", in_, out_}, {"meter", in_}, {"stream", in_, folder_.path("out")}}) {
    for (const char* seconds : {"0", "4"}) {
      std::vector<std::string> arguments = command;
      arguments.insert(arguments.end(), {"-q", "--server", server.address(), "--resume", seconds});
      const int before = server.calls();
      const Outcome outcome = candela(arguments);
      EXPECT_EQ(outcome.code, 1);
      EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
      EXPECT_NE(outcome.err.find("server has 3 calls"), std::string::npos) << outcome.err;
      if (seconds[0] == '0') {
        EXPECT_EQ(server.calls(), before + 1);
      } else {
        EXPECT_GE(server.calls(), before + 2);
      }
    }
  }
}

}  // namespace
}  // namespace candela
