// Whether there is a GPU, without asking Vulkan. Internal to server/vulkan and its tests.
#pragma once

#include <filesystem>

namespace candela {

// Whether the kernel shows one among its devices: a render node of DRM, or NVIDIA's or WSL's own. It may
// still have no driver for Vulkan.
bool has_gpu(const std::filesystem::path& devices = "/dev");

}  // namespace candela
