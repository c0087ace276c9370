// `candela info`: describes files, a configuration of OpenColorIO, or a server.
#include <unistd.h>

#include <CLI/App.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render_batch.h"
#include "client/cli/json_output.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/options.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/terminal.h"
#include "client/color/view_config.h"
#include "client/image/color.h"
#include "client/image/describe.h"
#include "client/image/read/image_stream.h"
#include "client/run/events.h"
#include "client/run/output_files.h"
#include "client/run/picture_frame.h"
#include "client/run/sequence.h"
#include "client/run/server_link.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"

namespace candela {
namespace {

// A line for the configuration and one for each display, each with a line end.
std::string to_text(const std::string& path, const ConfigViews& config) {
  std::string text = absl::StrFormat("%s: OpenColorIO configuration, version %s, %d colour spaces\n", path,
                                     config.version, config.color_spaces.size());
  for (const ConfigViews::Display& display : config.displays) {
    absl::StrAppend(&text, "  display \"", display.name, "\"",
                    display.name == config.default_display ? " (default)" : "", "\n");
    for (const std::string& view : display.views) {
      absl::StrAppend(&text, "    view \"", view, "\"", view == display.default_view ? " (default)" : "",
                      "\n");
    }
  }
  return text;
}

// One object on one line, with the keys config, version, default_display, displays (of name, default_view and
// views) and color_spaces.
std::string to_json(const std::string& path, const ConfigViews& config) {
  nlohmann::ordered_json displays = nlohmann::ordered_json::array();
  for (const ConfigViews::Display& display : config.displays) {
    displays.push_back(
        {{"name", display.name}, {"default_view", display.default_view}, {"views", display.views}});
  }
  return line_of(nlohmann::ordered_json{{"config", path},
                                        {"version", config.version},
                                        {"default_display", config.default_display},
                                        {"displays", displays},
                                        {"color_spaces", config.color_spaces}});
}

// Describes image files, for `candela info FILE...`.

using Json = nlohmann::ordered_json;

std::string window_words(const WindowFacts& window) {
  return absl::StrFormat("%dx%d at %d,%d", window.right - window.left + 1, window.bottom - window.top + 1,
                         window.left, window.top);
}

bool same(const WindowFacts& a, const WindowFacts& b) {
  return a.left == b.left && a.top == b.top && a.right == b.right && a.bottom == b.bottom;
}

std::string primaries_words(const PartFacts& part) {
  const std::string from = absl::StrCat(
      part.aces_container ? "; acesImageContainerFlag 1" : "",
      part.color_interop_id.empty() ? "" : absl::StrCat("; colorInteropID ", part.color_interop_id));
  if (!part.chromaticities) return "not named; Rec.709 is assumed" + from;
  const NamedPrimaries* known = find_primaries(*part.chromaticities);
  return (known != nullptr ? known->known_as : xy_words(*part.chromaticities)) + from;
}

// "A B G R half; Z float; BY RY half, every 2nd column and row"
std::string channel_words(const std::vector<ChannelFacts>& channels) {
  std::string words, before;
  for (const ChannelFacts& channel : channels) {
    std::string kind = channel.type;
    if (channel.x_sampling != 1 || channel.y_sampling != 1) {
      absl::StrAppendFormat(&kind, " subsampled %dx%d", channel.x_sampling, channel.y_sampling);
    }
    if (kind != before) {
      if (!words.empty()) absl::StrAppend(&words, " ", before, "; ");
      before = kind;
    } else {
      words += " ";
    }
    words += channel.name;
  }
  return absl::StrCat(words, " ", before);
}

Json to_json(const WindowFacts& window) {
  return {{"left", window.left}, {"top", window.top}, {"right", window.right}, {"bottom", window.bottom}};
}

Json to_json(const PartFacts& part) {
  Json primaries, rate, channels = Json::array();
  if (part.chromaticities) {
    const NamedPrimaries* known = find_primaries(*part.chromaticities);
    primaries = {{"name", known != nullptr ? Json(known->name) : Json()}, {"xy", *part.chromaticities}};
  }
  if (part.frames_per_second > 0) rate = part.frames_per_second;
  for (const ChannelFacts& channel : part.channels) {
    channels.push_back({{"name", channel.name},
                        {"type", channel.type},
                        {"x_sampling", channel.x_sampling},
                        {"y_sampling", channel.y_sampling}});
  }
  return {{"name", part.name},
          {"storage", part.storage},
          {"compression", part.compression},
          {"display_window", to_json(part.display)},
          {"data_window", to_json(part.data)},
          {"pixel_aspect", part.pixel_aspect},
          {"frames_per_second", rate},
          {"primaries", primaries},
          {"color_interop_id", part.color_interop_id},
          {"aces_image_container", part.aces_container},
          {"views", part.views},
          {"layers", part.layers},
          {"channels", channels}};
}

// Several lines, each with a line end.
std::string to_text(const std::string& path, const FileFacts& facts) {
  std::string text = absl::StrFormat("%s: %s\n", escaped(path), facts.kind);
  const auto line = [&text](const std::string& name, const std::string& words) {
    absl::StrAppendFormat(&text, "  %-10s %s\n", name, words);
  };
  const absl::string_view why = facts.renderable.message();
  line("renders", facts.renderable.ok()
                      ? facts.shown
                      : absl::StrCat("nothing: ", absl::StripPrefix(why, absl::StrCat(path, ": "))));
  for (const std::string& note : facts.notes) line("", note);
  for (size_t i = 0; i < facts.parts.size(); ++i) {
    const PartFacts& part = facts.parts[i];
    if (facts.parts.size() > 1) line(absl::StrCat("part ", i + 1), part.name);
    line("size", window_words(part.display) +
                     (same(part.display, part.data) ? "" : ", data window " + window_words(part.data)));
    line("stored", part.storage + (part.compression.empty() ? "" : ", compression " + part.compression));
    line("primaries", primaries_words(part));
    if (part.pixel_aspect != 1)
      line("aspect", in_digits(part.pixel_aspect, 6) + ", width to height of a pixel");
    if (part.frames_per_second > 0) line("rate", in_digits(part.frames_per_second, 6) + " frames/s");
    if (!part.views.empty()) line("views", absl::StrJoin(part.views, ", "));
    if (!part.layers.empty()) line("layers", absl::StrJoin(part.layers, ", "));
    if (!part.channels.empty()) line("channels", channel_words(part.channels));
  }
  return text;
}

// One object on one line, with the keys file, kind, shown (null if nothing can be rendered), error (null if
// something can), notes and parts. A part has the keys name, storage, compression, display_window and
// data_window {left, top, right, bottom}, pixel_aspect, frames_per_second (null if the file names none),
// primaries {name, xy} (null if the file names none; name null if they have none), views, layers, and
// channels {name, type, x_sampling, y_sampling}.
std::string to_json(const std::string& path, const FileFacts& facts) {
  Json parts = Json::array(), shown, error;
  for (const PartFacts& part : facts.parts) parts.push_back(to_json(part));
  if (facts.renderable.ok()) {
    shown = facts.shown;
  } else {
    error = std::string(facts.renderable.message());
  }
  const Json json = {{"file", path},   {"kind", facts.kind},   {"shown", shown},
                     {"error", error}, {"notes", facts.notes}, {"parts", parts}};
  // A path may not be UTF-8, so invalid bytes are replaced.
  return line_of(json);
}

template <typename Enum, typename Values>
std::vector<std::string> words_of(const Values& values) {
  std::vector<std::string> words;
  for (const int value : values) words.push_back(v1::word_of(static_cast<Enum>(value)));
  return words;
}

struct ServerWords {
  explicit ServerWords(const v1::GetServerInfoResponse& info)
      : formats(words_of<v1::PixelFormat>(info.formats())),
        output_formats(words_of<v1::OutputFormat>(info.output_formats())),
        curves(words_of<v1::ToneCurve>(info.curves())),
        transfers(words_of<v1::Transfer>(info.transfers())) {}

  std::vector<std::string> formats, output_formats, curves, transfers;
};

std::string mib(uint64_t bytes) { return in_digits(static_cast<double>(bytes) / (1 << 20), 4) + " MiB"; }

// "within 0.0851 codes, with bloom without a bound"
std::string numbers_of(const v1::Tier& tier) {
  const auto codes = [](double bound) {
    return bound >= 0 && bound < 255 ? absl::StrCat("within ", rounded_up(bound), " codes")
                                     : std::string("without a bound");
  };
  return absl::StrFormat("%s, with bloom %s", codes(tier.max_error_codes()),
                         codes(tier.max_error_codes_with_bloom()));
}

std::string driver_of(const v1::DeviceInfo& device) {
  if (device.api_version().empty()) return "none: there is no Vulkan device, and there are no environments";
  return absl::StrFormat("%s, Vulkan %s", device.driver(), device.api_version());
}

std::string to_text(const v1::GetServerInfoResponse& info, const std::string& address) {
  const ServerWords words(info);
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
  line("driver", driver_of(device));
  if (!device.passes().empty()) line("passes", absl::StrCat("on the ", device.passes()));
  if (!device.bits().empty()) line("bits", device.bits());
  if (info.shared_memory()) line("transport", "shared memory, for sessions from this machine");
  line("takes", absl::StrJoin(words.formats, ", "));
  line("gives", absl::StrJoin(words.output_formats, ", "));
  line("curves", absl::StrJoin(words.curves, ", "));
  line("transfers", absl::StrJoin(words.transfers, ", "));
  for (const v1::Tier& tier : info.tiers()) {
    line("tier", tier.name() + ": " + tier.summary());
    line("", numbers_of(tier));
  }
  line("",
       "These errors hold for the default settings, an exposure of at most 1 and no negative components.");
  line("limits", absl::StrFormat("%d pixels per side, %s per frame, %s per band, %s for textures",
                                 limits.max_dimension(), mib(limits.max_frame_bytes()),
                                 mib(limits.max_band_bytes()), mib(limits.memory_budget_bytes())));
  line("textures", absl::StrFormat("%d reused, %d allocated; %s in use, %s idle, %s at the peak", pool.hits(),
                                   pool.misses(), mib(pool.bytes_in_use()), mib(pool.bytes_idle()),
                                   mib(pool.bytes_peak())));
  line("work", absl::StrFormat("%d frames in %d s", info.frames_rendered(), info.uptime_seconds()));
  return text;
}

// A number, switch, choice or text as JSON has it; null if an absent setting stays absent.
nlohmann::ordered_json default_value(const v1::SettingInfo& setting) {
  const v1::Setting& declaration = setting.declaration();
  if (setting.kind() == v1::SettingInfo::KIND_SWITCH) return declaration.default_() != 0;
  if (!declaration.default_word().empty()) return declaration.default_word();
  if (declaration.has_default_()) return declaration.default_();
  return nullptr;
}

nlohmann::ordered_json to_json(const v1::SettingInfo& setting) {
  const v1::Setting& declaration = setting.declaration();
  nlohmann::ordered_json object = {{"path", setting.path()},           {"kind", v1::word_of(setting.kind())},
                                   {"flag", declaration.flag()},       {"group", declaration.group()},
                                   {"help", declaration.help()},       {"unit", declaration.unit()},
                                   {"default", default_value(setting)}};
  if (declaration.min() < declaration.max()) {
    object["min"] = declaration.min();
    object["max"] = declaration.max();
  }
  for (const v1::SettingInfo::Choice& choice : setting.choices()) {
    object["choices"].push_back({{"word", choice.word()}, {"summary", choice.summary()}});
  }
  for (const v1::Setting::Exception& exception : declaration.except()) {
    nlohmann::ordered_json row = {{"choice", exception.choice()}, {"word", exception.word()}};
    if (exception.has_min()) row["min"] = exception.min();
    if (exception.has_max()) row["max"] = exception.max();
    if (exception.has_default_()) row["default"] = exception.default_();
    if (!exception.default_word().empty()) row["default"] = exception.default_word();
    object["except"].push_back(row);
  }
  return object;
}

std::string to_json(const v1::GetServerInfoResponse& info, const std::string& address) {
  const ServerWords words(info);
  nlohmann::ordered_json tiers = nlohmann::ordered_json::array();
  for (const v1::Tier& tier : info.tiers()) {
    tiers.push_back({{"name", tier.name()},
                     {"summary", tier.summary()},
                     {"max_error_codes", tier.max_error_codes()},
                     {"max_error_codes_with_bloom", tier.max_error_codes_with_bloom()}});
  }
  nlohmann::ordered_json settings = nlohmann::ordered_json::array();
  for (const v1::SettingInfo& setting : info.settings()) settings.push_back(to_json(setting));
  const nlohmann::ordered_json server = {
      {"address", address},
      {"version", info.version()},
      {"device",
       {{"name", info.device().name()},
        {"type", info.device().type()},
        {"driver", info.device().driver()},
        {"api_version", info.device().api_version()},
        {"unified_memory", info.device().unified_memory()},
        {"passes", info.device().passes()},
        {"bits", info.device().bits()}}},
      {"shared_memory", info.shared_memory()},
      {"formats", words.formats},
      {"output_formats", words.output_formats},
      {"curves", words.curves},
      {"transfers", words.transfers},
      {"tiers", tiers},
      {"limits",
       {{"max_frame_bytes", info.limits().max_frame_bytes()},
        {"max_dimension", info.limits().max_dimension()},
        {"max_band_bytes", info.limits().max_band_bytes()},
        {"memory_budget_bytes", info.limits().memory_budget_bytes()},
        {"environment_budget_bytes", info.limits().environment_budget_bytes()}}},
      {"pool",
       {{"hits", info.pool().hits()},
        {"misses", info.pool().misses()},
        {"bytes_in_use", info.pool().bytes_in_use()},
        {"bytes_idle", info.pool().bytes_idle()},
        {"bytes_peak", info.pool().bytes_peak()}}},
      {"uptime_seconds", info.uptime_seconds()},
      {"frames_rendered", info.frames_rendered()},
      {"settings", settings},
  };
  return line_of(server);
}

absl::Status describe_server(const InfoOptions& options, JsonOutput& json) {
  RunEvents silent;
  ServerLink link(options.server, silent);
  const absl::StatusOr<v1::GetServerInfoResponse> info = link.info();
  if (!info.ok()) return info.status();
  const std::string& address = options.server.address;
  if (!json.to_stdout()) {
    RETURN_IF_ERROR(print(to_text(*info, address)));
  }
  return json.write(to_json(*info, address));
}

// A file that cannot be described does not stop the others.
absl::Status describe_files(const InfoOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const FoundFiles found, files_of_inputs(options.files, options.only));
  const std::vector<std::string>& files = found.paths;
  print_left_out(found.left_out);
  size_t failed = 0;
  std::optional<FailureKind> failed_for;
  for (const std::string& file : files) {
    const absl::StatusOr<FileFacts> facts =
        file == "-" ? describe_piped_image(STDIN_FILENO, kStdinName, default_image_limits())
                    : describe_image(file, default_image_limits());
    if (!facts.ok()) {
      if (files.size() == 1) return facts.status();
      print_error(facts.status());
      ++failed;
      add_failure(failed_for, facts.status());
      const std::string line = line_of({{"file", file},
                                        {"error", std::string(facts.status().message())},
                                        {"code", exit_code(kind_of(facts.status()))}});
      RETURN_IF_ERROR(json.add(line));
      continue;
    }
    absl::Status status;
    if (!json.to_stdout()) status = print(to_text(file, *facts));
    status.Update(json.add(to_json(file, *facts)));
    if (!status.ok()) return status;
  }
  if (absl::Status status = json.close(); !status.ok() || failed == 0) return status;
  return failure_of(*failed_for, absl::UnknownError(absl::StrFormat("%d of %d files cannot be described",
                                                                    failed, files.size())));
}

absl::Status describe_config(const std::string& path, JsonOutput& json) {
  const absl::StatusOr<ConfigViews> views = views_of({.config = path, .source = "--ocio"});
  if (!views.ok()) return input_failure(views.status(), path);
  if (!json.to_stdout()) {
    RETURN_IF_ERROR(print(to_text(path, *views)));
  }
  return json.write(to_json(path, *views));
}

absl::Status run_info(const InfoOptions& options, JsonOutput& json) {
  std::vector<std::string> inputs = files_of(options.server);
  for (const std::string& file : options.files) inputs.push_back(file == "-" ? "/dev/stdin" : file);
  if (!options.config.empty()) inputs.push_back(options.config);
  if (absl::Status status = check_outputs_apart(inputs, {{options.json, "the JSON"}}); !status.ok()) {
    return status;
  }
  RETURN_IF_ERROR(json.open());
  if (!options.config.empty()) return describe_config(options.config, json);
  return options.files.empty() ? describe_server(options, json) : describe_files(options, json);
}

constexpr char kInfoExamples[] =
    "`candela info FILE...` also says what would be rendered of each file.\n"
    "`candela info --json -` also lists every setting with its range, default and choices.\n\n"
    "Examples:\n"
    "  candela info\n"
    "  candela info shot.exr\n"
    "  candela info photos/ --only jpg --json -\n"
    "  candela info --ocio studio.ocio\n"
    "  candela info --server 127.0.0.1:50051 --json -";

Finish define_info(CLI::App& app) {
  const auto options = std::make_shared<InfoOptions>();
  app.add_option("FILE", options->files,
                 "Images to describe, folders of them, quoted patterns such as 'in/*.exr', or - for one from "
                 "standard input (default: describe the server)")
      ->option_text("...");
  add_only_option(app, options->only);
  add_text(app, kOutputSection, "--ocio", "CONFIG",
           "Describe this OpenColorIO configuration: its displays and views, and in JSON its colour spaces",
           options->config);
  add_json_option(app, kOutputSection,
                  "Write one line of JSON a file, or one for the server with every setting", options->json);
  add_server_options(app, options->server);
  return [options](const GivenOptions&) -> absl::StatusOr<ParsedCommand> {
    if (!options->config.empty() && !options->files.empty()) {
      return usage_error("--ocio describes a configuration and FILE an image; give only one of them");
    }
    absl::Status status = check_input_names(options->files, /*stdin_too=*/true);
    status.Update(finish_server_options(options->server));
    if (!status.ok()) return status;
    return parsed_command(*options, run_info);
  };
}

}  // namespace

const Command kInfoCommand{
    "info", "Describes image files: parts, layers, channels, windows. Without files, describes a server.",
    kInfoExamples, define_info};

}  // namespace candela
