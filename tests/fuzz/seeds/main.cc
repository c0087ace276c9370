// Writes the fuzzers' seeds: `fuzz_seeds FOLDER` makes FOLDER/image and FOLDER/wire.
#include <filesystem>
#include <string>

#include "tests/fuzz/seeds/seeds.h"

int main(int count, char** arguments) {
  if (count != 2) return 2;
  const std::string image = std::string(arguments[1]) + "/image", wire = std::string(arguments[1]) + "/wire";
  std::filesystem::create_directories(image);
  std::filesystem::create_directories(wire);
  candela::write_image_seeds(image);
  candela::write_wire_seeds(wire);
}
