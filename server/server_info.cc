#include "server/server_info.h"

#include <algorithm>

#include "proto/candela/v1/settings.h"
#include "server/render/settings/error_bound.h"
#include "server/render/settings/tiers.h"

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {

FrameLimits frame_limits(const Config& config, const DeviceSummary& device) {
  return {config.max_dimension, std::min(config.max_frame_bytes, device.max_allocation_bytes)};
}

v1::GetServerInfoResponse server_info(const Config& config, const RenderDevice& opened) {
  const DeviceSummary& device = opened.device->summary();
  v1::GetServerInfoResponse info;
  info.set_version(CANDELA_VERSION);
  v1::DeviceInfo& about = *info.mutable_device();
  about.set_name(device.name);
  about.set_type(device.type);
  about.set_driver(device.driver);
  about.set_api_version(device.api_version);
  about.set_unified_memory(device.unified_memory);
  about.set_passes(executor_word(opened.renderer->executor_kind()));
  about.set_bits(opened.bits);
  for (int i = 1; v1::PixelFormat_IsValid(i); ++i) info.add_formats(static_cast<v1::PixelFormat>(i));
  for (int i = 1; v1::OutputFormat_IsValid(i); ++i) info.add_output_formats(static_cast<v1::OutputFormat>(i));
  for (int i = 1; v1::ToneCurve_IsValid(i); ++i) info.add_curves(static_cast<v1::ToneCurve>(i));
  for (int i = 1; v1::Transfer_IsValid(i); ++i) info.add_transfers(static_cast<v1::Transfer>(i));
  for (const Tier& tier : tiers()) {
    v1::Tier& row = *info.add_tiers();
    row.set_name(tier.name);
    row.set_summary(tier.summary);
    const Settings settings;
    BoundFacts facts = {.exposure = 1, .threshold = settings->bloom().threshold()};
    row.set_max_error_codes(error_bound(tier, settings, facts));
    facts.blooms = true;
    row.set_max_error_codes_with_bloom(error_bound(tier, settings, facts));
  }
  for (const v1::SettingField& setting : v1::setting_fields())
    *info.add_settings() = v1::setting_info(setting);
  const FrameLimits limits = frame_limits(config, device);
  info.mutable_limits()->set_max_frame_bytes(limits.max_frame_bytes);
  info.mutable_limits()->set_max_dimension(limits.max_dimension);
  info.mutable_limits()->set_max_band_bytes(v1::kMaxBandBytes);
  info.mutable_limits()->set_memory_budget_bytes(config.memory_budget_bytes);
  const bool bakes = opened.renderer->check_environments().ok();
  info.mutable_limits()->set_environment_budget_bytes(bakes ? config.environment_budget_bytes : 0);
  info.mutable_limits()->set_max_sessions(config.max_sessions);
  info.mutable_limits()->set_max_frames_in_flight(config.max_frames_in_flight);
  return info;
}

}  // namespace candela
