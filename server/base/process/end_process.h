// The end of candela and of candelad.
#pragma once

#include <unistd.h>

#include <cstdio>

namespace candela {

// Ends the process at once, with its output written. exit() would also clean up OpenSSL, while a thread of
// gRPC that is about to end still uses it: https://github.com/grpc/grpc/issues/38539.
[[noreturn]] inline void end_process(int code) {
  std::fflush(nullptr);
  _exit(code);
}

}  // namespace candela
