// Starting a program under test, and the environment.
#pragma once

#include <sys/types.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace candela {

// Sets an environment variable during a test.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) { setenv(name, value, 1); }
  ~Variable() { unsetenv(name_); }

 private:
  const char* name_;
};

// A pipe. Programs do not inherit its ends, and the owner closes them.
struct Pipe {
  Pipe();
  int ends[2];  // read, write
};

// Starts `program` with an empty stdin. Its stdout and stderr become these descriptors. It uses the tests'
// cache folder instead of the user's. Returns -1 if it cannot be started.
pid_t spawn(const std::string& program, const std::vector<std::string>& arguments, int output, int error);

}  // namespace candela
