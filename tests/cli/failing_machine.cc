// A library that is preloaded into the command and makes memory or the disk fail, as the environment says.
//   CANDELA_TEST_MOST_NEW_BYTES=N  operator new throws for more than N bytes
//   CANDELA_TEST_FSYNC_FAILS=1     fsync fails
#include <cerrno>
#include <cstdlib>
#include <new>

void* operator new(std::size_t bytes) {
  const char* most = std::getenv("CANDELA_TEST_MOST_NEW_BYTES");
  void* memory = most != nullptr && bytes > std::strtoull(most, nullptr, 10) ? nullptr : std::malloc(bytes);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void* operator new[](std::size_t bytes) { return operator new(bytes); }
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

extern "C" int fsync(int) {
  if (std::getenv("CANDELA_TEST_FSYNC_FAILS") == nullptr) return 0;
  errno = EIO;
  return -1;
}
