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
#include "tests/support/status.h"

namespace candela {
namespace {

using RenderWire = grpc::ServerReaderWriter<v1::RenderResponse, v1::RenderRequest>;
using StreamWire = grpc::ServerReaderWriter<v1::StreamResponse, v1::StreamRequest>;

constexpr uint32_t kWidth = 31, kHeight = 17;
constexpr size_t kFrameBytes = kWidth * kHeight * 8;
constexpr uint32_t kCubeSize = 16;

// Refuses the first calls as candelad does: UNAVAILABLE, and a RetryInfo of half a second. With `late` it
// first reads the whole frame, as if the device were lost. Then it answers with grey images of kWidth x
// kHeight.
class FullServer : public v1::RenderService::Service {
 public:
  // `bake_refusals` bakes are refused after their panoramas were taken.
  FullServer(int refusals, bool late, int bake_refusals = 0)
      : left_(refusals), bake_refusals_(bake_refusals), late_(late) {
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
    *response.mutable_header() = header();
    stream->Write(response);
    response.mutable_band()->set_pixels(std::string(kWidth * kHeight * 4, bytes == kFrameBytes ? 'x' : '?'));
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

  grpc::Status Stream(grpc::ServerContext*, StreamWire* stream) override {
    ++calls_;
    if (left_-- > 0) return full();
    v1::StreamRequest request;
    v1::StreamResponse response;
    stream->Read(&request);
    response.mutable_opened()->set_session(request.open().session());
    response.mutable_opened()->set_max_frames_in_flight(2);
    stream->Write(response);
    uint64_t sequence = 0;
    size_t bytes = 0;
    while (stream->Read(&request)) {
      if (request.has_frame()) sequence = request.frame().sequence();
      bytes += request.band().pixels().size();
      const bool whole = bytes == kFrameBytes || request.frame().has_view();
      if (!whole) continue;
      bytes = 0;
      *response.mutable_header() = header();
      response.mutable_header()->set_sequence(sequence);
      stream->Write(response);
      response.mutable_band()->set_pixels(std::string(kWidth * kHeight * 4, 'x'));
      stream->Write(response);
    }
    return grpc::Status::OK;
  }

  // It never has the panorama already.
  grpc::Status GetEnvironment(grpc::ServerContext*, const v1::GetEnvironmentRequest*,
                              v1::Environment*) override {
    return {grpc::NOT_FOUND, "unknown"};
  }

  grpc::Status PutEnvironment(grpc::ServerContext*, grpc::ServerReader<v1::PutEnvironmentRequest>* reader,
                              v1::Environment* environment) override {
    ++calls_;
    if (left_-- > 0) return full();
    v1::PutEnvironmentRequest request;
    while (reader->Read(&request)) continue;
    environment->set_id(std::string(64, 'e'));
    environment->set_default_cube_size(kCubeSize);
    return grpc::Status::OK;
  }

  grpc::Status BakeEnvironment(grpc::ServerContext*, const v1::BakeEnvironmentRequest*,
                               grpc::ServerWriter<v1::BakeEnvironmentResponse>* writer) override {
    ++calls_;
    if (bake_refusals_-- > 0) return full();
    v1::BakeEnvironmentResponse response;
    response.mutable_header()->set_size(kCubeSize);
    response.mutable_header()->add_levels()->set_size(kCubeSize);
    writer->Write(response);
    for (uint32_t face = 0; face < 6; ++face) {
      response.mutable_face()->set_face(face);
      writer->Write(response);
      response.mutable_band()->set_pixels(std::string(kCubeSize * kCubeSize * 8, '\x11'));
      writer->Write(response);
    }
    return grpc::Status::OK;
  }

 private:
  static v1::ResultHeader header() {
    v1::ResultHeader header;
    header.set_width(kWidth);
    header.set_height(kHeight);
    header.set_format(v1::OUTPUT_FORMAT_RGBA8);
    header.set_exposure(1);
    return header;
  }

  static grpc::Status full() {
    const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
    const std::string info("\x0a\x06\x10\x80\xca\xb5\xee\x01", 8);
    const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                            std::string(1, static_cast<char>(info.size())) + info;
    const std::string details = "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any;
    return {grpc::UNAVAILABLE, "server has 3 calls, which is its limit; try again soon", details};
  }

  std::atomic<int> left_;
  std::atomic<int> bake_refusals_;
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
    EXPECT_EQ(png_facts(out_).width, kWidth);
  }
  FullServer server(2, false);
  EXPECT_EQ(candela({"meter", in_, "-q", "--server", server.address()}).code, 0);
  EXPECT_EQ(server.calls(), 3);
}

TEST_F(FullServerTest, SequencesViewsAndEnvironmentsWaitForItToo) {
  struct Case {
    std::vector<std::string> arguments;
    int calls;  // beside those that are refused
    std::string output;
  };
  const std::string size = std::to_string(kWidth) + "x" + std::to_string(kHeight);
  const std::string folder = folder_.path("frames"), turn = folder_.path("turn/%04d.png");
  for (const auto& [arguments, calls, output] :
       std::vector<Case>{{{"stream", in_, folder}, 1, folder + "/in.png"},
                         {{"view", in_, out_, "--size", size}, 2, out_},
                         {{"view", in_, turn, "--size", size, "--turn", "90", "--frames", "2"},
                          2,
                          folder_.path("turn/0001.png")},
                         {{"environment", in_, folder_.path("sky.ktx2")}, 2, folder_.path("sky.ktx2")}}) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    FullServer server(2, false);
    std::vector<std::string> all = arguments;
    all.insert(all.end(), {"--server", server.address()});
    const Outcome outcome = candela(all);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(server.calls(), 2 + calls);
    EXPECT_TRUE(says(outcome.err, "waiting for up to 30s (--resume)\n"));
    EXPECT_NE(read_file(output), "");
  }
  // A bake that is refused brings its panorama again, because it may go to another server.
  FullServer server(0, false, 2);
  const Outcome outcome =
      candela({"environment", in_, folder_.path("again.ktx2"), "-q", "--server", server.address()});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(server.calls(), 6);
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
           {"render", in_, out_},
           {"meter", in_},
           {"stream", in_, folder_.path("out")},
           {"view", in_, out_},
           {"view", in_, folder_.path("turn/%04d.png"), "--turn", "90", "--frames", "2"},
           {"environment", in_, folder_.path("sky.ktx2")}}) {
    for (const char* seconds : {"0", "4"}) {
      if (seconds[0] != '0' && command[0] != "meter" && command[0] != "stream") continue;  // they wait alike
      std::vector<std::string> arguments = command;
      arguments.insert(arguments.end(), {"-q", "--server", server.address(), "--resume", seconds});
      const int before = server.calls();
      const Outcome outcome = candela(arguments);
      EXPECT_EQ(outcome.code, 4);
      EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
      EXPECT_TRUE(says(outcome.err, "server has 3 calls"));
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
