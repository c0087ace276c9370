// The changes between two versions of the contract that break a program built with the older one.
#pragma once

#include <google/protobuf/descriptor.h>

#include <string>
#include <vector>

namespace candela::testing {

// One line for each change that docs/compatibility.md does not allow and that descriptors show, in the order
// of the older contract: "candela.v1.Bloom.intensity: number was 1 and is 9". Empty if there is none.
std::vector<std::string> breaking_changes(const google::protobuf::FileDescriptor& older,
                                          const google::protobuf::FileDescriptor& newer);

}  // namespace candela::testing
