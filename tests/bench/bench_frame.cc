// The frame of the benchmarks as a file for other programs, without its alpha: bench_frame WIDTH HEIGHT
// OUT.exr
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "client/image/image.h"
#include "tests/support/scenes.h"

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  const auto width = static_cast<uint32_t>(std::atoi(argv[1]));
  const auto height = static_cast<uint32_t>(std::atoi(argv[2]));
  absl::StatusOr<candela::Image> image = candela::make_image(width, height, candela::ImageFormat::kRgba16f);
  absl::Status status = image.status();
  if (image.ok()) {
    const candela::testing::WireFrame frame =
        candela::testing::make_frame(width, height, candela::v1::PIXEL_FORMAT_RGBA16F,
                                     candela::testing::ordinary(candela::scenes::natural(width, height)));
    std::memcpy(image->pixels.data(), frame.pixels.data(), frame.pixels.size());
    status = candela::write_image(argv[3], *image).status();
  }
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
