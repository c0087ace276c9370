#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "proto/candela/v1/settings.h"

namespace candela {
namespace {

template <typename Enum, typename Values>
std::vector<std::string> words_of(const Values& values) {
  std::vector<std::string> words;
  for (const int value : values) words.push_back(v1::word_of(static_cast<Enum>(value)));
  return words;
}

struct Words {
  explicit Words(const v1::GetServerInfoResponse& info)
      : formats(words_of<v1::PixelFormat>(info.formats())),
        output_formats(words_of<v1::OutputFormat>(info.output_formats())),
        curves(words_of<v1::ToneCurve>(info.curves())),
        transfers(words_of<v1::Transfer>(info.transfers())) {}

  std::vector<std::string> formats, output_formats, curves, transfers;
};

std::string mib(uint64_t bytes) {
  return absl::StrFormat("%.4g MiB", static_cast<double>(bytes) / (1 << 20));
}

std::string to_text(const v1::GetServerInfoResponse& info, const std::string& address) {
  const Words words(info);
  const v1::DeviceInfo& device = info.device();
  const v1::Limits& limits = info.limits();
  const v1::PoolInfo& pool = info.pool();
  std::string text =
      absl::StrFormat("candela %s, %s\n", info.version(), address.empty() ? "in this process" : address);
  const auto line = [&text](const char* name, const std::string& value) {
    absl::StrAppendFormat(&text, "  %-10s %s\n", name, value);
  };
  line("device", absl::StrFormat("%s (%s%s)", device.name(), device.type(),
                                 device.unified_memory() ? ", unified memory" : ""));
  line("driver", absl::StrFormat("%s, Vulkan %s", device.driver(), device.api_version()));
  line("takes", absl::StrJoin(words.formats, ", "));
  line("gives", absl::StrJoin(words.output_formats, ", "));
  line("curves", absl::StrJoin(words.curves, ", "));
  line("transfers", absl::StrJoin(words.transfers, ", "));
  for (const v1::Tier& tier : info.tiers()) line("tier", tier.name() + ": " + tier.summary());
  line("limits", absl::StrFormat("%d pixels per side, %s per frame, %s per band, %s for textures",
                                 limits.max_dimension(), mib(limits.max_frame_bytes()),
                                 mib(limits.max_band_bytes()), mib(limits.memory_budget_bytes())));
  line("textures", absl::StrFormat("%d reused, %d allocated; %s in use, %s idle, %s at the peak", pool.hits(),
                                   pool.misses(), mib(pool.bytes_in_use()), mib(pool.bytes_idle()),
                                   mib(pool.bytes_peak())));
  line("work", absl::StrFormat("%d frames in %d s", info.frames_rendered(), info.uptime_seconds()));
  return text;
}

std::string to_json(const v1::GetServerInfoResponse& info, const std::string& address) {
  const Words words(info);
  nlohmann::ordered_json tiers = nlohmann::ordered_json::array();
  for (const v1::Tier& tier : info.tiers())
    tiers.push_back({{"name", tier.name()}, {"summary", tier.summary()}});
  const nlohmann::ordered_json server = {
      {"address", address},
      {"version", info.version()},
      {"device",
       {{"name", info.device().name()},
        {"type", info.device().type()},
        {"driver", info.device().driver()},
        {"api_version", info.device().api_version()},
        {"unified_memory", info.device().unified_memory()}}},
      {"formats", words.formats},
      {"output_formats", words.output_formats},
      {"curves", words.curves},
      {"transfers", words.transfers},
      {"tiers", tiers},
      {"limits",
       {{"max_frame_bytes", info.limits().max_frame_bytes()},
        {"max_dimension", info.limits().max_dimension()},
        {"max_band_bytes", info.limits().max_band_bytes()},
        {"memory_budget_bytes", info.limits().memory_budget_bytes()}}},
      {"pool",
       {{"hits", info.pool().hits()},
        {"misses", info.pool().misses()},
        {"bytes_in_use", info.pool().bytes_in_use()},
        {"bytes_idle", info.pool().bytes_idle()},
        {"bytes_peak", info.pool().bytes_peak()}}},
      {"uptime_seconds", info.uptime_seconds()},
      {"frames_rendered", info.frames_rendered()},
  };
  return server.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace

absl::Status run_info(const InfoOptions& options) {
  absl::StatusOr<JsonOutput> json = JsonOutput::open(options.json);
  if (!json.ok()) return json.status();
  ServerLink link(options.server);
  const absl::StatusOr<v1::GetServerInfoResponse> info = link.info();
  if (!info.ok()) return info.status();
  const std::string& address = options.server.address;
  if (!json->to_stdout()) {
    if (absl::Status status = print(to_text(*info, address)); !status.ok()) return status;
  }
  return json->write(to_json(*info, address));
}

}  // namespace candela
