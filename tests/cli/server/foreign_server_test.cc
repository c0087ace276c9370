// The command with servers that are not candelad: whatever they send, the user gets a one-line error.
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>

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

}  // namespace
}  // namespace candela
