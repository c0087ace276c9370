#include "client/image/read/exr_choice.h"

#include <OpenEXR/ImfPartType.h>

#include <optional>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/image/read/exr_color.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

struct Candidate {
  int part = 0;
  ExrLayer layer;
};

std::string part_name(const Imf::Header& header) { return header.hasName() ? header.name() : ""; }

absl::Status nothing_called(const std::string& path, const char* what, const std::string& name,
                            const std::vector<std::string>& names) {
  if (names.empty()) {
    return absl::NotFoundError(absl::StrFormat("%s: there is no %s \"%s\"; the file names no %ss", path, what,
                                               printable(name), what));
  }
  return absl::NotFoundError(absl::StrFormat("%s: there is no %s \"%s\"; there are: %s", path, what,
                                             printable(name), name_list(names)));
}

// The parts that --part allows.
absl::StatusOr<std::vector<int>> chosen_parts(const std::string& path, const Imf::MultiPartInputFile& file,
                                              const std::string& choice) {
  std::vector<int> all;
  std::vector<std::string> names;
  for (int i = 0; i < file.parts(); ++i) {
    const std::string name = part_name(file.header(i));
    if (!choice.empty() && name == choice) return std::vector<int>{i};
    all.push_back(i);
    names.push_back(name.empty() ? absl::StrFormat("%d", i + 1) : absl::StrFormat("%d %s", i + 1, name));
  }
  int number = 0;
  if (choice.empty()) return all;
  if (absl::SimpleAtoi(choice, &number) && number >= 1 && number <= file.parts()) {
    return std::vector<int>{number - 1};
  }
  return nothing_called(path, "part", choice, names);
}

// The parts that may be shown: those of data (exr_color.h) only if the user chose a part or a layer, or wants
// the values as they stand and there are no others.
std::vector<int> colour_parts(const Imf::MultiPartInputFile& file, const std::vector<int>& parts,
                              const PictureChoice& choice) {
  if (!choice.part.empty() || !choice.layer.empty()) return parts;
  std::vector<int> colour = parts;
  std::erase_if(colour, [&](int part) { return holds_data(file.header(part)); });
  return colour.empty() && choice.own_values ? parts : colour;
}

// Keeps the candidates of a view.
absl::Status keep_view(const std::string& path, const std::string& view, std::vector<Candidate>& candidates) {
  if (view.empty()) return absl::OkStatus();
  std::vector<std::string> views;
  for (const Candidate& candidate : candidates) add_once(views, candidate.layer.view);
  if (!absl::c_linear_search(views, view)) return nothing_called(path, "view", view, views);
  std::erase_if(candidates, [&](const Candidate& candidate) { return candidate.layer.view != view; });
  return absl::OkStatus();
}

// Keeps the candidates of a layer. A full channel name makes a layer of that channel alone.
absl::Status keep_layer(const std::string& path, const std::string& layer,
                        std::vector<Candidate>& candidates) {
  if (layer.empty()) return absl::OkStatus();
  std::vector<std::string> names;
  std::vector<Candidate> kept;
  std::optional<Candidate> channel;
  for (const Candidate& candidate : candidates) {
    const ExrLayer& known = candidate.layer;
    add_once(names, known.name);
    if (known.name == layer || known.prefix == layer + ".") kept.push_back(candidate);
    if (!channel && absl::c_linear_search(known.channels, layer)) {
      channel = Candidate{candidate.part, {known.view, known.name, known.prefix, {layer}}};
    }
  }
  if (kept.empty() && channel) kept.push_back(*channel);
  if (kept.empty()) {
    for (const Candidate& candidate : candidates) {
      if (!candidate.layer.name.empty()) continue;
      for (const std::string& plain : candidate.layer.channels) add_once(names, plain);
    }
    return nothing_called(path, "layer", layer, names);
  }
  candidates = std::move(kept);
  return absl::OkStatus();
}

// Whether the candidate was made of a single channel by keep_layer().
bool is_channel(const Candidate& candidate, const std::string& choice) {
  return candidate.layer.channels.size() == 1 && candidate.layer.channels.front() == choice;
}

// The first candidate that can be shown.
std::optional<std::pair<Candidate, ExrChannels>> first_picture(const Imf::MultiPartInputFile& file,
                                                               const std::vector<Candidate>& candidates,
                                                               const PictureChoice& choice) {
  const auto channels = [&](const Candidate& c) -> const Imf::ChannelList& {
    return file.header(c.part).channels();
  };
  for (const Candidate& candidate : candidates) {
    if (is_channel(candidate, choice.layer)) {
      return std::pair(candidate, ExrChannels{.kind = ExrChannels::Kind::kGrey,
                                              .prefix = candidate.layer.prefix,
                                              .red = choice.layer});
    }
    if (auto colour = colour_of(channels(candidate), candidate.layer)) {
      return std::pair(candidate, *std::move(colour));
    }
  }
  for (const Candidate& candidate : candidates) {
    // Without a choice, only if the part has nothing else.
    const auto layers = absl::c_count_if(candidates, [&](const Candidate& c) {
      return c.part == candidate.part && c.layer.channels != std::vector{c.layer.prefix + "A"};
    });
    if (choice.empty() && layers != 1) continue;
    const auto data = data_of(channels(candidate), candidate.layer);
    if (data && (!choice.empty() || data->kind == ExrChannels::Kind::kGrey))
      return std::pair(candidate, *data);
  }
  return std::nullopt;
}

std::vector<std::string> notes_of(const Imf::MultiPartInputFile& file, const Candidate& shown,
                                  const PictureChoice& choice) {
  std::vector<std::string> notes;
  const std::string name = part_name(file.header(shown.part));
  if (shown.part > 0 && choice.part.empty()) {
    notes.push_back(absl::StrFormat("part %d of %d, %s, is shown", shown.part + 1, file.parts(),
                                    name.empty() ? "unnamed" : printable(name)));
  }
  if (!shown.layer.name.empty() && choice.layer.empty()) {
    notes.push_back(absl::StrFormat("layer %s is shown", printable(shown.layer.name)));
  }
  return notes;
}

absl::Status nothing_to_show(const std::string& path, const Imf::MultiPartInputFile& file,
                             const std::vector<int>& parts, const std::vector<Candidate>& candidates,
                             const PictureChoice& choice) {
  const bool deep = absl::c_any_of(parts, [&](int part) { return is_deep(file.header(part)); });
  if (deep && (candidates.empty() || choice.empty())) {
    return absl::UnimplementedError(
        absl::StrFormat("%s: this is a deep image, which cannot be rendered; flatten it first", path));
  }
  if (candidates.empty() && absl::c_all_of(parts, [&](int part) { return holds_data(file.header(part)); })) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its colorInteropID is data, so it holds numbers and no colours; --part %d shows them as light",
        path, parts.front() + 1));
  }
  if (!choice.empty()) {
    std::vector<std::string> names;
    for (const Candidate& candidate : candidates) {
      for (const std::string& channel : candidate.layer.channels) add_once(names, channel);
    }
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: nothing chosen has colour (it has %s); name one of these channels as the layer",
                        path, name_list(names)));
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: no colour channels (it has %s); it needs R G B, Y, Y RY BY or a single channel, "
                      "or name one as the "
                      "layer",
                      path, channel_names(file.header(parts.front()).channels())));
}

}  // namespace

void add_once(std::vector<std::string>& names, const std::string& name) {
  if (!name.empty() && !absl::c_linear_search(names, name)) names.push_back(name);
}

bool is_deep(const Imf::Header& header) { return header.hasType() && Imf::isDeepData(header.type()); }

absl::StatusOr<ExrPicture> choose_exr_picture(const std::string& path, const Imf::MultiPartInputFile& file,
                                              const PictureChoice& choice) {
  const absl::StatusOr<std::vector<int>> parts = chosen_parts(path, file, choice.part);
  if (!parts.ok()) return parts.status();
  std::vector<Candidate> candidates;
  for (const int part : colour_parts(file, *parts, choice)) {
    if (is_deep(file.header(part))) continue;
    for (ExrLayer& layer : layers_of(file.header(part))) candidates.push_back({part, std::move(layer)});
  }
  if (candidates.empty()) return nothing_to_show(path, file, *parts, candidates, choice);
  absl::Status status = keep_view(path, choice.view, candidates);
  if (status.ok()) status = keep_layer(path, choice.layer, candidates);
  if (!status.ok()) return status;
  auto shown = first_picture(file, candidates, choice);
  if (!shown) return nothing_to_show(path, file, *parts, candidates, choice);
  return ExrPicture{shown->first.part, std::move(shown->second), notes_of(file, shown->first, choice)};
}

}  // namespace candela
