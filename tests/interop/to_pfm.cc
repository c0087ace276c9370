// Any image that Candela reads as a PFM, which a Python program reads in a few lines: to_pfm IN OUT.pfm
#include <cstdio>

#include "client/image/image.h"

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  absl::StatusOr<candela::Image> image = candela::read_image(argv[1]);
  const absl::Status status = image.ok() ? candela::write_image(argv[2], *image).status() : image.status();
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
