// Streams one second of a scene that gets brighter, and prints the exposure of each frame. Usage: example
// SERVER...
#include <candela/session.h>

#include <cstdio>
#include <thread>

int main(int argc, char** argv) {
  candela::SessionOptions options;
  options.servers.assign(argv + 1, argv + argc);
  absl::StatusOr<candela::Session> session = candela::Session::open(options);
  if (!session.ok()) return std::fprintf(stderr, "%s\n", session.status().ToString().c_str()), 1;

  std::thread producer([&] {
    for (uint64_t i = 0; i < 24; ++i) {
      const auto pixels = std::make_shared<std::vector<float>>(64 * 64 * 4, i < 12 ? 0.05f : 5.0f);
      candela::SessionFrame frame;
      frame.width = frame.height = 64;
      frame.format = candela::v1::PIXEL_FORMAT_RGBA32F;
      frame.pixels = std::as_bytes(std::span(*pixels));
      frame.owner = pixels;  // the session keeps it until the frame has its result
      frame.sequence = i;
      frame.media_time_ns = static_cast<int64_t>(i) * 1'000'000'000 / 24;
      if (!session->submit(std::move(frame)).ok()) break;  // next_result() returns the reason
    }
    session->finish();
  });
  absl::StatusOr<std::optional<candela::FrameResult>> result;
  while ((result = session->next_result()).ok() && *result) {
    const candela::RenderResult& image = (*result)->image;
    std::printf("frame %d: exposure %.4f, first byte %d\n", static_cast<int>((*result)->sequence),
                image.header.exposure(), image.bytes > 0 ? static_cast<int>(image.data[0]) : -1);
  }
  producer.join();
  if (!result.ok()) std::fprintf(stderr, "%s\n", result.status().ToString().c_str());
  return result.ok() ? 0 : 1;
}
