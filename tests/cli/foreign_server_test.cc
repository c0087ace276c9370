// The command with servers that are not candelad: whatever they send, the user gets a one-line error.
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "candela/v1/render.grpc.pb.h"
#include "client/connection.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Wire = grpc::ServerReaderWriter<v1::RenderResponse, v1::RenderRequest>;
using Answer = std::function<grpc::Status(grpc::ServerContext&, Wire&)>;

// Accepts any frame, reads all of it and answers as the test says.
class ForeignServer : public v1::RenderService::Service {
 public:
  explicit ForeignServer(Answer answer) : answer_(std::move(answer)) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }
  ~ForeignServer() override { server_->Shutdown(); }

  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

  grpc::Status GetServerInfo(grpc::ServerContext*, const v1::GetServerInfoRequest*,
                             v1::GetServerInfoResponse* info) override {
    info->mutable_limits()->set_max_dimension(1024);
    info->mutable_limits()->set_max_frame_bytes(1 << 20);
    return grpc::Status::OK;
  }
  grpc::Status Render(grpc::ServerContext* context, Wire* stream) override {
    v1::RenderRequest request;
    while (stream->Read(&request)) {
    }
    return answer_(*context, *stream);
  }

 private:
  const Answer answer_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

void send_header(Wire& stream, uint32_t width, uint32_t height) {
  v1::RenderResponse response;
  response.mutable_header()->set_width(width);
  response.mutable_header()->set_height(height);
  response.mutable_header()->set_format(v1::OUTPUT_FORMAT_RGBA8);
  stream.Write(response);
}

void send_band(Wire& stream, uint32_t first_row, size_t bytes) {
  v1::RenderResponse response;
  response.mutable_band()->set_first_row(first_row);
  response.mutable_band()->set_pixels(std::string(bytes, 'x'));
  stream.Write(response);
}

void send_verified_header(Wire& stream) {
  v1::RenderResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_width(31);
  header.set_height(17);
  header.set_format(v1::OUTPUT_FORMAT_RGBA8);
  header.mutable_verify()->set_max_error_codes(1);
  stream.Write(response);
}

void send_map_band(Wire& stream, uint32_t first_row, size_t bytes) {
  v1::RenderResponse response;
  response.mutable_error_map()->set_first_row(first_row);
  response.mutable_error_map()->set_pixels(std::string(bytes, '\x11'));
  stream.Write(response);
}

// The command's message for such an answer to its frame of 31 x 17 pixels.
std::string words_for(Answer answer, const std::vector<std::string>& options = {}) {
  const TemporaryFolder folder;
  write_small_exr(folder.path("in.exr"));
  const ForeignServer server(std::move(answer));
  std::vector<std::string> arguments = with({"render", folder.path("in.exr"), folder.path("out.png"),
                                             "--server", server.address(), "--resume", "0", "-q"},
                                            options);
  if (!options.empty() && options.back() == "--error-map") arguments.push_back(folder.path("map.png"));
  const Outcome outcome = candela(arguments);
  EXPECT_EQ(outcome.code, outcome.err.empty() ? 0 : 4) << outcome.err;
  return outcome.err;
}

TEST(ForeignServer, AGoodAnswerIsTaken) {
  EXPECT_EQ(words_for([](grpc::ServerContext&, Wire& stream) {
              send_header(stream, 31, 17);
              send_band(stream, 0, 31 * 17 * 4);
              return grpc::Status::OK;
            }),
            "");
}

TEST(ForeignServer, ACallThatItEndsMayHaveBeenIdle) {
  const std::string words = words_for([](grpc::ServerContext& context, Wire&) {
    context.TryCancel();
    return grpc::Status::CANCELLED;
  });
  EXPECT_TRUE(says(words,
                   "ended the call: it is stopping, or the client read nothing for longer than its "
                   "--idle-timeout; try again"));
}

TEST(ForeignServer, AnErrorWithoutWordsIsNamedByItsCode) {
  const auto fail_with = [](grpc::StatusCode code) {
    return words_for([code](grpc::ServerContext&, Wire&) { return grpc::Status(code, ""); });
  };
  EXPECT_TRUE(says(fail_with(grpc::INTERNAL), ": INTERNAL\n"));
  EXPECT_TRUE(says(fail_with(grpc::UNAVAILABLE), ": UNAVAILABLE; "));
}

TEST(ForeignServer, AnEmptyBandIsRefused) {
  const std::string words = words_for([](grpc::ServerContext&, Wire& stream) {
    send_header(stream, 31, 17);
    send_band(stream, 0, 0);
    send_band(stream, 0, 31 * 17 * 4);
    return grpc::Status::OK;
  });
  EXPECT_TRUE(says(words, "an empty band"));
}

TEST(ForeignServer, AnErrorMapIsTakenAsTheImageIs) {
  constexpr size_t kImage = 31 * 17 * 4, kMap = 31 * 17 * 2;
  struct Case {
    std::function<void(Wire&)> send;
    std::string words;  // "" for success
  };
  for (const Case& c : std::vector<Case>{
           {[](Wire& s) { send_band(s, 0, kImage), send_map_band(s, 0, kMap); }, ""},
           {[](Wire& s) { send_band(s, 0, kImage), send_map_band(s, 0, 62), send_map_band(s, 1, kMap - 62); },
            ""},
           {[](Wire& s) { send_band(s, 0, kImage); }, "before the error map was whole"},
           {[](Wire& s) { send_map_band(s, 0, kMap), send_band(s, 0, kImage); },
            "no band, but a band is due"},
           {[](Wire& s) { send_band(s, 0, kImage), send_map_band(s, 1, kMap); }, "out of order"},
           {[](Wire& s) { send_band(s, 0, kImage), send_map_band(s, 0, kMap + 2); }, "more than"},
           {[](Wire& s) { send_band(s, 0, kImage), send_map_band(s, 0, 0); }, "an empty band"},
           {[](Wire& s) { send_band(s, 0, kImage), send_band(s, 0, kImage); },
            "no band, but a band is due"}}) {
    const std::string words = words_for(
        [&c](grpc::ServerContext&, Wire& stream) {
          send_verified_header(stream);
          c.send(stream);
          return grpc::Status::OK;
        },
        {"--error-map"});
    EXPECT_EQ(words.empty(), c.words.empty()) << words;
    EXPECT_TRUE(says(words, c.words));
  }
}

TEST(ForeignServer, AMapThatNobodyAskedForIsRefused) {
  const std::string words = words_for(
      [](grpc::ServerContext&, Wire& stream) {
        send_verified_header(stream);
        send_band(stream, 0, 31 * 17 * 4);
        send_map_band(stream, 0, 31 * 17 * 2);
        return grpc::Status::OK;
      },
      {"--verify"});
  EXPECT_TRUE(says(words, "does not follow render.proto"));
}

TEST(ForeignServer, AnImageOfAnotherSizeIsRefusedBeforeMemoryIsTaken) {
  const auto words_of = [](uint32_t width, uint32_t height, const std::vector<std::string>& options) {
    return words_for(
        [width, height](grpc::ServerContext&, Wire& stream) {
          send_header(stream, width, height);
          send_band(stream, 0, size_t{62} * 34 * 4);
          return grpc::Status::OK;
        },
        options);
  };
  EXPECT_EQ(words_of(62, 34, {"--resize", "200%"}), "");
  EXPECT_TRUE(says(words_of(31, 17, {"--resize", "200%"}), "the server ignores the size of images"));
  EXPECT_TRUE(says(words_of(4000000000, 4000000000, {"--max-size", "16"}),
                   "the image has 4000000000x4000000000 pixels and not 16x9"));
  EXPECT_TRUE(says(words_of(62, 34, {}), "the image has 62x34 pixels and not 31x17"));
}

TEST(ForeignServer, AServerThatDoesNotVerifyIsNamedAsOne) {
  const std::string words = words_for(
      [](grpc::ServerContext&, Wire& stream) {
        send_header(stream, 31, 17);
        send_band(stream, 0, 31 * 17 * 4);
        return grpc::Status::OK;
      },
      {"--verify"});
  EXPECT_TRUE(says(words, "does not verify frames"));
}

TEST(ForeignServer, AFrameWithoutPixelsIsRefusedBeforeItIsSent) {
  const ForeignServer server([](grpc::ServerContext&, Wire& stream) {
    send_header(stream, 0, 0);
    send_band(stream, 0, 0);
    return grpc::Status::OK;
  });
  ASSERT_OK_AND_ASSIGN(const Connection connection, Connection::open(server.address()));
  for (const auto& [width, height] : {std::pair<uint32_t, uint32_t>{0, 0}, {0, 3}, {3, 0}}) {
    EXPECT_REFUSED(kInvalidArgument, "at least 1x1",
                   connection.render({}, {.width = width, .height = height, .pixels = {}}));
  }
}

// The command with servers that are too busy for its work, or are lost with it: it waits and repeats within
// --resume.

using RenderWire = grpc::ServerReaderWriter<v1::RenderResponse, v1::RenderRequest>;
using StreamWire = grpc::ServerReaderWriter<v1::StreamResponse, v1::StreamRequest>;

constexpr uint32_t kFrameWidth = 31, kFrameHeight = 17;
constexpr size_t kFrameBytes = kFrameWidth * kFrameHeight * 8;
constexpr uint32_t kCubeSize = 16;

// Refuses the first calls as candelad does: UNAVAILABLE, and a RetryInfo of half a second. With `late` it
// first reads the whole frame, as if the device were lost. Then it answers with grey images of kFrameWidth x
// kFrameHeight.
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
    response.mutable_band()->set_pixels(
        std::string(kFrameWidth * kFrameHeight * 4, bytes == kFrameBytes ? 'x' : '?'));
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
      response.mutable_band()->set_pixels(std::string(kFrameWidth * kFrameHeight * 4, 'x'));
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
    header.set_width(kFrameWidth);
    header.set_height(kFrameHeight);
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
    EXPECT_EQ(png_facts(out_).width, kFrameWidth);
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
  const std::string size = std::to_string(kFrameWidth) + "x" + std::to_string(kFrameHeight);
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
