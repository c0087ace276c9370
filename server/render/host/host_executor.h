// Renders plans on the host's processors, in the textures that the device maps.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "server/base/crew.h"
#include "server/render/frame/executor.h"
#include "server/render/frame/table_points.h"
#include "server/render/host/resolve.h"
#include "server/vulkan/device.h"

namespace candela {

namespace host {

// "AVX2", "AVX-512" or "NEON", whichever they use; null if the processor has none with fused multiply-add, so
// that no kernel runs.
const char* instruction_set();

}  // namespace host

// The same image, whatever the number of threads.
class HostExecutor final : public Executor {
 public:
  // Why the host cannot make the passes of a device; empty if it can.
  static std::string unavailable(const DeviceSummary& device);

  // Renders with `threads` threads, one of them the caller's. The device, which only holds the textures,
  // outlives the executor.
  HostExecutor(const Device& device, uint32_t threads) : device_(device), crew_(threads) {}

  // Its threads, for other work between two calls.
  Crew& crew() { return crew_; }

 private:
  bool copies_rows() const override { return true; }
  absl::StatusOr<Metered> run_meter(FrameMemory& memory, const IngestPlan& plan) override;
  absl::StatusOr<Drawn> run_draw(FrameMemory& memory, const Plan& plan,
                                 std::vector<StageTime>* stages) override;
  // UNAVAILABLE if the device is lost: its memory may be, too.
  absl::Status usable() const;
  // A table's points; null if there is none.
  std::shared_ptr<const host::TablePoints> points_of(const std::shared_ptr<const ColorTable>& table);

  const Device& device_;
  Crew crew_;
  TablesUsedLast<host::TablePoints> tables_;
};

}  // namespace candela
