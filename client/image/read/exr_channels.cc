#include "client/image/read/exr_channels.h"

#include <vector>

#include "absl/algorithm/container.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// The name up to and including its last dot; "" for a plain name.
std::string prefix_of(const std::string& name) { return name.substr(0, name.rfind('.') + 1); }

std::optional<ExrChannels> choose_in_layer(const Imf::ChannelList& channels, const std::string& prefix) {
  const auto find = [&](const char* base) {
    const std::string name = absl::StrCat(prefix, base);
    return channels.findChannel(name) != nullptr ? name : std::string();
  };
  ExrChannels chosen{.layer = prefix.substr(0, prefix.empty() ? 0 : prefix.size() - 1),
                     .red = find("R"),
                     .green = find("G"),
                     .blue = find("B"),
                     .alpha = find("A")};
  const int primaries = !chosen.red.empty() + !chosen.green.empty() + !chosen.blue.empty();
  if (primaries >= 2) return chosen;
  const std::string luminance = find("Y");
  if (!luminance.empty() && !find("RY").empty() && !find("BY").empty()) {
    chosen.kind = ExrChannels::Kind::kLumaChroma;
    return chosen;
  }
  chosen.kind = ExrChannels::Kind::kGrey;
  if (primaries == 1) {
    chosen.red = absl::StrCat(chosen.red, chosen.green, chosen.blue);
  } else if (!luminance.empty() && find("X").empty()) {  // X and Y make a vector
    chosen.red = luminance;
  } else {
    return std::nullopt;
  }
  chosen.green.clear();
  chosen.blue.clear();
  return chosen;
}

}  // namespace

std::optional<ExrChannels> choose_exr_channels(const Imf::ChannelList& channels, bool lone) {
  std::vector<std::string> prefixes{""};
  std::vector<std::string> not_alpha;
  for (auto i = channels.begin(); i != channels.end(); ++i) {
    const std::string name = i.name();
    const std::string prefix = prefix_of(name);
    if (!absl::c_linear_search(prefixes, prefix)) prefixes.push_back(prefix);
    if (name != prefix + "A") not_alpha.push_back(name);
  }
  for (const std::string& prefix : prefixes) {
    if (auto chosen = choose_in_layer(channels, prefix)) return chosen;
  }
  if (!lone || not_alpha.size() != 1) return std::nullopt;
  const std::string& name = not_alpha.front();
  const std::string alpha = prefix_of(name) + "A";
  return ExrChannels{.kind = ExrChannels::Kind::kGrey,
                     .red = name,
                     .alpha = channels.findChannel(alpha) != nullptr ? alpha : ""};
}

std::string channel_names(const Imf::ChannelList& channels) {
  constexpr size_t kShown = 12;
  std::vector<std::string> names;
  for (auto i = channels.begin(); i != channels.end(); ++i) {
    if (names.size() == kShown) {
      names.push_back("...");
      break;
    }
    names.push_back(printable(i.name()));
  }
  return absl::StrJoin(names, ", ");
}

}  // namespace candela
