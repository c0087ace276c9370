// A library that is preloaded into candelad and gives its machine 16 processors. gRPC then has more places
// where its threads wait.
#include <dlfcn.h>
#include <unistd.h>

extern "C" long sysconf(int name) noexcept {
  static const auto right = reinterpret_cast<long (*)(int)>(dlsym(RTLD_NEXT, "sysconf"));
  return name == _SC_NPROCESSORS_CONF || name == _SC_NPROCESSORS_ONLN ? 16 : right(name);
}
