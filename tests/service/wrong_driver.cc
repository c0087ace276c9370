// A library that is preloaded into candelad and makes its Vulkan device wrong: every dispatch leaves out the
// last column of workgroups, so the image's right edge is not drawn.
#include <dlfcn.h>
#include <vulkan/vulkan_core.h>

#include <algorithm>

extern "C" void vkCmdDispatchBase(VkCommandBuffer commands, uint32_t x, uint32_t y, uint32_t z,
                                  uint32_t columns, uint32_t rows, uint32_t layers) {
  static const auto right = reinterpret_cast<PFN_vkCmdDispatchBase>(dlsym(RTLD_NEXT, "vkCmdDispatchBase"));
  right(commands, x, y, z, std::max(columns, 1u) - 1, rows, layers);
}
