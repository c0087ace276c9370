// Linked into every program of a build with the address sanitizer. A Vulkan driver stays loaded when its
// instance is destroyed, so that the leak sanitizer can name the library in which a block was allocated.

extern "C" int dlclose(void*) { return 0; }
