#include "client/cli/commands/file_info.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "client/base/number_words.h"
#include "client/cli/files/failure_line.h"
#include "client/cli/files/terminal.h"
#include "client/image/primaries.h"

namespace candela {
namespace {

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

}  // namespace

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

}  // namespace candela
