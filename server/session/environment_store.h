// The environments that a server keeps for all its clients.
#pragma once

#include <atomic>
#include <cstdint>
#include <list>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "candela/v1/render.pb.h"
#include "server/render/environment/environment_baker.h"
#include "server/render/frame_maker.h"

namespace candela {

// A part of the environment budget, which is given back on destruction. Movable.
class EnvironmentRoom {
 public:
  EnvironmentRoom() = default;
  EnvironmentRoom(std::shared_ptr<std::atomic<uint64_t>> used, uint64_t bytes);
  EnvironmentRoom(EnvironmentRoom&& other) noexcept;
  EnvironmentRoom& operator=(EnvironmentRoom&& other) noexcept;
  ~EnvironmentRoom();

  uint64_t bytes() const { return bytes_; }
  // Adds the bytes of the other one to this one.
  void add(EnvironmentRoom other);

 private:
  std::shared_ptr<std::atomic<uint64_t>> used_;
  uint64_t bytes_ = 0;
};

// An environment of the store. Whoever holds a reference to it uses it, and keeps it alive.
struct KeptEnvironment {
  v1::Environment facts;  // without `stages` and `had_it`; does not change
  EnvironmentRoom room;
  std::shared_ptr<FrameMaker> renderer;     // of the device that holds the textures
  Environment environment;                  // the render thread's
  std::atomic<bool> sky_ready = false;      // views without objects may be rendered
  std::atomic<bool> objects_ready = false;  // all views
  std::atomic<bool> preparing = false;

  const std::string& id() const { return facts.id(); }
  bool ready_for(const View& view) const { return view.objects.empty() ? sky_ready : objects_ready; }
};
using EnvironmentUse = std::shared_ptr<KeptEnvironment>;

// Keeps the environments that were used last, within a budget. Any thread.
class EnvironmentStore {
 public:
  explicit EnvironmentStore(uint64_t budget_bytes) : budget_bytes_(budget_bytes) {}

  // RESOURCE_EXHAUSTED if the budget can never hold an environment of `bytes`.
  absl::Status check_size(uint64_t bytes) const;

  // Room for an environment of `bytes`. Frees environments that nobody uses, the one that was used longest
  // ago first. RESOURCE_EXHAUSTED if the budget can never hold it, UNAVAILABLE if others use too much of it
  // now.
  absl::StatusOr<EnvironmentRoom> make_room(uint64_t bytes);

  // Adds the environment to the store. If one with the same id is there already, returns that one.
  EnvironmentUse keep(EnvironmentUse environment);

  // The environment with this id on the device of `renderer`; it counts as used now. INVALID_ARGUMENT, naming
  // `field`, if the id has not the form of one; NOT_FOUND, naming the id; or what check_environments() says.
  absl::StatusOr<EnvironmentUse> find(absl::string_view field, const std::string& id,
                                      const FrameMaker& renderer);

  // Forgets the environment. Returns whether somebody still uses it. Fails as find() does.
  absl::StatusOr<bool> drop(const std::string& id, const FrameMaker& renderer);

  // Forgets the environments on devices other than that of `renderer`.
  void forget_others(const FrameMaker& renderer);

  // Frees the environment that nobody uses and that was used longest ago. False if there is none.
  bool free_one();

  uint64_t budget_bytes() const { return budget_bytes_; }
  uint64_t used_bytes() const { return *used_; }

 private:
  // Moves it out of the list, so that its textures are freed outside the lock; null if all are used.
  EnvironmentUse take_unused() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::list<EnvironmentUse>::iterator position(const std::string& id, const FrameMaker& renderer)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const uint64_t budget_bytes_;
  const std::shared_ptr<std::atomic<uint64_t>> used_ = std::make_shared<std::atomic<uint64_t>>(0);
  absl::Mutex mutex_;
  std::list<EnvironmentUse> kept_ ABSL_GUARDED_BY(mutex_);  // the one that was used last at the end
};

// What an environment for a panorama of this size takes of the budget, with everything that views need.
uint64_t environment_bytes(uint32_t width, uint64_t panorama_bytes);

}  // namespace candela
