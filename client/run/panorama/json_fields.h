// Reads the small JSON files that users write: objects of a scene, keys of a camera.
#pragma once

#include <array>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/candela/v1/limits.h"

namespace candela {

// The object in the file `path`. `what` is what the file should hold, as "camera keys". Errors begin with the
// path: NOT_FOUND if it cannot be read, INVALID_ARGUMENT if it is no JSON object or is larger than 1 MiB.
absl::StatusOr<nlohmann::json> read_json(const std::string& path, const std::string& what);

// The members of one object. The first failure goes into `status`; later ones are left out.
class JsonFields {
 public:
  // `name` stands before the members' names in errors, as "keys[2]."; `object` and `status` must outlive it.
  JsonFields(const nlohmann::json& object, std::string name, absl::Status& status)
      : object_(object), name_(std::move(name)), status_(status) {}

  // Refuses anything but an object with some of these members, so that a typing error does not go unnoticed.
  void allow(std::initializer_list<const char*> members);

  // Without a value for `absent` the member must be there.
  double number(const char* key, v1::Range<double> range, std::optional<double> absent);
  std::array<double, 3> triple(const char* key, v1::Range<double> range,
                               std::optional<std::array<double, 3>> absent);
  bool flag(const char* key, bool absent);
  // An array with at least `least` elements, which must be there.
  const nlohmann::json& array(const char* key, size_t least, size_t most);

  void fail(const std::string& key, const std::string& wanted);

 private:
  const nlohmann::json* member(const char* key) const;

  const nlohmann::json& object_;
  const std::string name_;
  absl::Status& status_;
};

}  // namespace candela
