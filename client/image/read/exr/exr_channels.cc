#include "client/image/read/exr/exr_channels.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfMultiView.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <cstring>
#include <initializer_list>

#include "absl/algorithm/container.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// The name up to and including its last dot; "" for a plain name.
std::string prefix_of(const std::string& name) { return name.substr(0, name.rfind('.') + 1); }

// The layer's channel of one of these names, "" if there is none.
std::string find(const ExrLayer& layer, std::initializer_list<const char*> names) {
  const auto base = [&](const std::string& channel) {
    return absl::string_view(channel).substr(layer.prefix.size());
  };
  for (const char* name : names) {
    for (const std::string& channel : layer.channels) {
      if (base(channel) == name) return channel;
    }
    for (const std::string& channel : layer.channels) {
      if (absl::EqualsIgnoreCase(base(channel), name)) return channel;
    }
  }
  return "";
}

bool has(const ExrLayer& layer, const char* base) {
  return absl::c_linear_search(layer.channels, layer.prefix + base);
}

std::string alpha_of(const ExrLayer& layer) { return find(layer, {"A", "alpha"}); }

// Colours whose names have no dot before R, G and B: LeR, LeG and LeB, or beauty_r, beauty_g and beauty_b.
// Takes them out of a layer and returns them as layers.
std::vector<ExrLayer> split_off_colours(ExrLayer& layer) {
  constexpr const char* kEnds[][4] = {{"R", "G", "B", "A"},
                                      {"r", "g", "b", "a"},
                                      {"Red", "Green", "Blue", "Alpha"},
                                      {"red", "green", "blue", "alpha"}};
  std::vector<ExrLayer> layers;
  for (const std::string& red : std::vector<std::string>(layer.channels)) {
    for (const auto& ends : kEnds) {
      if (red.size() <= layer.prefix.size() + std::strlen(ends[0]) || !absl::EndsWith(red, ends[0])) continue;
      const std::string prefix = red.substr(0, red.size() - std::strlen(ends[0]));
      // AR, AG and AB are the alphas of the colours, and a small letter after a letter may be any word's.
      const char last = prefix.back();
      const bool begins = !absl::ascii_isalpha(static_cast<unsigned char>(last)) ||
                          (absl::ascii_islower(static_cast<unsigned char>(last)) &&
                           absl::ascii_isupper(static_cast<unsigned char>(*ends[0])));
      if (!begins) continue;
      std::vector<std::string> channels;
      for (const char* end : ends) {
        if (absl::c_binary_search(layer.channels, prefix + end)) channels.push_back(prefix + end);
      }
      if (channels.size() < 3 || channels[2] != prefix + ends[2]) continue;
      std::string name = layer.name + (layer.name.empty() ? "" : ".") + prefix.substr(layer.prefix.size());
      while (name.size() > 1 && absl::ascii_ispunct(static_cast<unsigned char>(name.back()))) name.pop_back();
      std::erase_if(layer.channels, [&](const std::string& c) { return absl::c_linear_search(channels, c); });
      layers.push_back({layer.view, std::move(name), prefix, std::move(channels)});
      break;
    }
  }
  return layers;
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
  for (size_t i = layers.size(); i-- > 0;) {
    std::vector<ExrLayer> colours = split_off_colours(layers[i]);
    if (layers[i].channels.empty()) layers.erase(layers.begin() + static_cast<std::ptrdiff_t>(i));
    layers.insert(layers.end(), colours.begin(), colours.end());
  }
  const std::string first = Imf::defaultViewName(views);
  absl::c_stable_sort(layers, [&](const ExrLayer& a, const ExrLayer& b) {
    const auto order = [&](const ExrLayer& l) { return std::pair(l.view != first, !l.name.empty()); };
    return order(a) < order(b);
  });
  return layers;
}

std::optional<ExrChannels> colour_of(const ExrLayer& layer) {
  ExrChannels chosen{.prefix = layer.prefix,
                     .red = find(layer, {"R", "red"}),
                     .green = find(layer, {"G", "green"}),
                     .blue = find(layer, {"B", "blue"}),
                     .alpha = alpha_of(layer)};
  const int primaries = !chosen.red.empty() + !chosen.green.empty() + !chosen.blue.empty();
  if (primaries >= 2) return chosen;
  if (has(layer, "Y") && has(layer, "RY") && has(layer, "BY")) {
    chosen.kind = ExrChannels::Kind::kLumaChroma;
    // OpenEXR decodes these three, and only A beside them.
    if (chosen.alpha != layer.prefix + "A") chosen.alpha.clear();
    return chosen;
  }
  chosen.kind = ExrChannels::Kind::kGrey;
  const std::string luminance = find(layer, {"Y"});
  if (primaries == 1) {
    chosen.red = absl::StrCat(chosen.red, chosen.green, chosen.blue);
  } else if (!luminance.empty() && find(layer, {"X"}).empty()) {  // X and Y make a vector
    chosen.red = luminance;
  } else {
    return std::nullopt;
  }
  chosen.green.clear();
  chosen.blue.clear();
  return chosen;
}

std::optional<ExrChannels> data_of(const ExrLayer& layer) {
  ExrChannels vector{.prefix = layer.prefix,
                     .red = find(layer, {"X"}),
                     .green = find(layer, {"Y"}),
                     .blue = find(layer, {"Z"}),
                     .alpha = alpha_of(layer)};
  if (has_xyz(layer)) return vector;
  std::vector<std::string> values = layer.channels;
  std::erase(values, vector.alpha);
  if (values.size() == 3) {
    vector.red = values[0], vector.green = values[1], vector.blue = values[2];
    return vector;
  }
  if (values.size() != 1) return std::nullopt;
  return ExrChannels{
      .kind = ExrChannels::Kind::kGrey, .prefix = layer.prefix, .red = values.front(), .alpha = vector.alpha};
}

bool has_xyz(const ExrLayer& layer) {
  return !find(layer, {"X"}).empty() && !find(layer, {"Y"}).empty() && !find(layer, {"Z"}).empty();
}

std::string shown_name(const std::string& name) {
  constexpr size_t kMostBytes = 255;  // of a channel's name
  return printable(name, kMostBytes);
}

bool is_called(const std::string& name, const std::string& choice) {
  return name == choice || shown_name(name) == choice;
}

std::string name_list(const std::vector<std::string>& names) {
  constexpr size_t kShown = 12;
  std::vector<std::string> shown;
  for (const std::string& name : names) {
    if (shown.size() == kShown) {
      shown.push_back("...");
      break;
    }
    shown.push_back(shown_name(name));
  }
  return absl::StrJoin(shown, ", ");
}

}  // namespace candela
