#include "server/session/environment_store.h"

#include <iterator>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/environment_id.h"
#include "server/base/status_macros.h"

namespace candela {

EnvironmentRoom::EnvironmentRoom(std::shared_ptr<std::atomic<uint64_t>> used, uint64_t bytes)
    : used_(std::move(used)), bytes_(bytes) {
  *used_ += bytes_;
}

EnvironmentRoom::EnvironmentRoom(EnvironmentRoom&& other) noexcept
    : used_(std::move(other.used_)), bytes_(std::exchange(other.bytes_, 0)) {}

EnvironmentRoom& EnvironmentRoom::operator=(EnvironmentRoom&& other) noexcept {
  std::swap(used_, other.used_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

void EnvironmentRoom::add(EnvironmentRoom other) {
  bytes_ += std::exchange(other.bytes_, 0);
  if (used_ == nullptr) used_ = std::move(other.used_);
}

EnvironmentRoom::~EnvironmentRoom() {
  if (used_ != nullptr) *used_ -= bytes_;
}

absl::Status EnvironmentStore::check_size(uint64_t bytes) const {
  if (bytes <= budget_bytes_) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrFormat(
      "the environment takes %d bytes and this server's environment-budget is %d; use a smaller panorama, or "
      "a server with a larger --environment-budget",
      bytes, budget_bytes_));
}

absl::StatusOr<EnvironmentRoom> EnvironmentStore::make_room(uint64_t bytes) {
  RETURN_IF_ERROR(check_size(bytes));
  std::list<EnvironmentUse> given_up;  // freed outside the lock
  absl::MutexLock lock(&mutex_);
  while (*used_ + bytes > budget_bytes_) {
    EnvironmentUse oldest = take_unused();
    if (oldest == nullptr) {
      return absl::UnavailableError(absl::StrFormat(
          "the environment takes %d bytes and those in use leave %d of this server's environment-budget; try "
          "again soon",
          bytes, budget_bytes_ - std::min<uint64_t>(*used_, budget_bytes_)));
    }
    oldest->room = {};
    given_up.push_back(std::move(oldest));
  }
  return EnvironmentRoom(used_, bytes);
}

EnvironmentUse EnvironmentStore::keep(EnvironmentUse environment) {
  absl::MutexLock lock(&mutex_);
  const auto other = position(environment->id(), *environment->renderer);
  if (other != kept_.end()) return *other;
  kept_.push_back(environment);
  return environment;
}

absl::StatusOr<EnvironmentUse> EnvironmentStore::find(absl::string_view field, const std::string& id,
                                                      const FrameMaker& renderer) {
  if (!v1::is_environment_id(id)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s is not the id of an environment; PutEnvironment returns ids, of 64 hex digits", field));
  }
  RETURN_IF_ERROR(renderer.check_environments());
  absl::MutexLock lock(&mutex_);
  const auto found = position(id, renderer);
  if (found == kept_.end()) {
    return absl::NotFoundError(
        absl::StrFormat("this server has no environment %s; put it there with PutEnvironment", id));
  }
  kept_.splice(kept_.end(), kept_, found);
  return *found;
}

absl::StatusOr<bool> EnvironmentStore::drop(const std::string& id, const FrameMaker& renderer) {
  ASSIGN_OR_RETURN(EnvironmentUse found, find("id", id, renderer));
  absl::MutexLock lock(&mutex_);
  kept_.remove(found);
  return found.use_count() > 1;
}

void EnvironmentStore::forget_others(const FrameMaker& renderer) {
  std::list<EnvironmentUse> others;  // freed outside the lock
  absl::MutexLock lock(&mutex_);
  for (auto kept = kept_.begin(); kept != kept_.end();) {
    const auto next = std::next(kept);
    if ((*kept)->renderer.get() != &renderer) others.splice(others.end(), kept_, kept);
    kept = next;
  }
}

bool EnvironmentStore::free_one() {
  EnvironmentUse oldest;  // freed outside the lock
  absl::MutexLock lock(&mutex_);
  oldest = take_unused();
  return oldest != nullptr;
}

EnvironmentUse EnvironmentStore::take_unused() {
  for (auto kept = kept_.begin(); kept != kept_.end(); ++kept) {
    if (kept->use_count() > 1) continue;
    EnvironmentUse taken = std::move(*kept);
    kept_.erase(kept);
    return taken;
  }
  return nullptr;
}

std::list<EnvironmentUse>::iterator EnvironmentStore::position(const std::string& id,
                                                               const FrameMaker& renderer) {
  auto kept = kept_.begin();
  while (kept != kept_.end() && ((*kept)->id() != id || (*kept)->renderer.get() != &renderer)) ++kept;
  return kept;
}

uint64_t environment_bytes(uint32_t width, uint64_t panorama_bytes) {
  const uint32_t size = view_cube_size(width);
  return panorama_bytes + chain_bytes(size) + specular_bytes(size);
}

}  // namespace candela
