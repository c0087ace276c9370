// Writes cube maps for compare.mjs: write_cubes FOLDER. Their texels are telling() of tests/unit.
#include <cstdio>
#include <string>

#include "client/environment/environment_files.h"
#include "tests/unit/image/baked_environment_support.h"

using namespace candela;

namespace {

absl::Status write_cube(const std::string& path, const std::vector<uint32_t>& sizes, Handedness handedness,
                        bool words) {
  BakedEnvironment environment = environment_of(sizes, telling);
  environment.handedness = handedness;
  if (words) convert_to_rgb9e5(environment);
  return write_ktx2(path, environment);
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 2) return 2;
  for (const Handedness handedness : {Handedness::kLeft, Handedness::kRight}) {
    for (const bool words : {false, true}) {
      for (const std::vector<uint32_t>& sizes :
           {std::vector<uint32_t>{64, 32, 16}, std::vector<uint32_t>{16}}) {
        const std::string path = std::string(arguments[1]) + "/" + name(handedness) +
                                 (words ? "-rgb9e5-" : "-rgba16f-") + std::to_string(sizes[0]) + ".ktx2";
        if (const absl::Status status = write_cube(path, sizes, handedness, words); !status.ok()) {
          std::fprintf(stderr, "%s\n", status.ToString().c_str());
          return 1;
        }
      }
    }
  }
}
