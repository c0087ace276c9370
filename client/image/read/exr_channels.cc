#include "client/image/read/exr_channels.h"

#include <OpenEXR/ImfMultiView.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>

#include "absl/algorithm/container.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// The name up to and including its last dot; "" for a plain name.
std::string prefix_of(const std::string& name) { return name.substr(0, name.rfind('.') + 1); }

// `name` within a layer, "" if the part has no such channel.
std::string find(const Imf::ChannelList& channels, const ExrLayer& layer, const char* base) {
  const std::string name = absl::StrCat(layer.prefix, base);
  return channels.findChannel(name) != nullptr ? name : std::string();
}

}  // namespace

std::vector<ExrLayer> layers_of(const Imf::Header& header) {
  const Imf::StringVector views = Imf::hasMultiView(header) ? Imf::multiView(header) : Imf::StringVector();
  std::vector<ExrLayer> layers;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
    const std::string channel = i.name(), prefix = prefix_of(channel);
    auto layer = absl::c_find_if(layers, [&](const ExrLayer& l) { return l.prefix == prefix; });
    if (layer == layers.end()) {
      const std::string view = !views.empty()     ? Imf::viewFromChannelName(channel, views)
                               : header.hasView() ? header.view()
                                                  : "";
      std::string name =
          views.empty() || view.empty() ? prefix : prefix_of(Imf::removeViewName(channel, view));
      if (!name.empty()) name.pop_back();
      layer = layers.insert(layers.end(), {view, std::move(name), prefix});
    }
    layer->channels.push_back(channel);
  }
  const std::string first = Imf::defaultViewName(views);
  absl::c_stable_sort(layers, [&](const ExrLayer& a, const ExrLayer& b) {
    const auto order = [&](const ExrLayer& l) { return std::pair(l.view != first, !l.name.empty()); };
    return order(a) < order(b);
  });
  return layers;
}

std::optional<ExrChannels> colour_of(const Imf::ChannelList& channels, const ExrLayer& layer) {
  ExrChannels chosen{.prefix = layer.prefix,
                     .red = find(channels, layer, "R"),
                     .green = find(channels, layer, "G"),
                     .blue = find(channels, layer, "B"),
                     .alpha = find(channels, layer, "A")};
  const int primaries = !chosen.red.empty() + !chosen.green.empty() + !chosen.blue.empty();
  if (primaries >= 2) return chosen;
  const std::string luminance = find(channels, layer, "Y");
  if (!luminance.empty() && !find(channels, layer, "RY").empty() && !find(channels, layer, "BY").empty()) {
    chosen.kind = ExrChannels::Kind::kLumaChroma;
    return chosen;
  }
  chosen.kind = ExrChannels::Kind::kGrey;
  if (primaries == 1) {
    chosen.red = absl::StrCat(chosen.red, chosen.green, chosen.blue);
  } else if (!luminance.empty() && find(channels, layer, "X").empty()) {  // X and Y make a vector
    chosen.red = luminance;
  } else {
    return std::nullopt;
  }
  chosen.green.clear();
  chosen.blue.clear();
  return chosen;
}

std::optional<ExrChannels> data_of(const Imf::ChannelList& channels, const ExrLayer& layer) {
  ExrChannels vector{.prefix = layer.prefix,
                     .red = find(channels, layer, "X"),
                     .green = find(channels, layer, "Y"),
                     .blue = find(channels, layer, "Z"),
                     .alpha = find(channels, layer, "A")};
  if (!vector.red.empty() && !vector.green.empty() && !vector.blue.empty()) return vector;
  std::vector<std::string> values = layer.channels;
  std::erase(values, vector.alpha);
  if (values.size() != 1) return std::nullopt;
  return ExrChannels{
      .kind = ExrChannels::Kind::kGrey, .prefix = layer.prefix, .red = values.front(), .alpha = vector.alpha};
}

std::string name_list(const std::vector<std::string>& names) {
  constexpr size_t kShown = 12;
  std::vector<std::string> shown;
  for (const std::string& name : names) {
    if (shown.size() == kShown) {
      shown.push_back("...");
      break;
    }
    shown.push_back(printable(name));
  }
  return absl::StrJoin(shown, ", ");
}

std::string channel_names(const Imf::ChannelList& channels) {
  std::vector<std::string> names;
  for (auto i = channels.begin(); i != channels.end(); ++i) names.emplace_back(i.name());
  return name_list(names);
}

}  // namespace candela
