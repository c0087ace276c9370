#include "client/image/read/exr/exr_choice.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfPartType.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "client/image/read/exr/exr_color.h"
#include "client/image/read/exr/exr_picture_rank.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// A layer of a part, and what it shows.
struct Candidate {
  int part = 0;
  ExrLayer layer;
  std::optional<ExrChannels> colour{}, data{};
  PictureRank rank{};
  bool other_view = false;  // than the file's first

  // Names after --layer that mean the plain channels of a part, which have no layer.
  bool is_rgb(const std::string& choice) const {
    return layer.name.empty() && colour && colour->kind == ExrChannels::Kind::kRgb &&
           (absl::EqualsIgnoreCase(choice, "RGB") || absl::EqualsIgnoreCase(choice, "RGBA"));
  }
  bool is_xyz(const std::string& choice) const {
    return layer.name.empty() && absl::EqualsIgnoreCase(choice, "XYZ") && has_xyz(layer);
  }
};

using Candidates = std::vector<const Candidate*>;

struct Shown {
  const Candidate* candidate;
  ExrChannels channels;

  bool operator==(const Shown& other) const {
    return candidate->part == other.candidate->part && channels == other.channels;
  }
};

std::string part_name(const Imf::Header& header) { return header.hasName() ? header.name() : ""; }

absl::Status nothing_called(const std::string& path, const char* what, const std::string& name,
                            const std::vector<std::string>& names) {
  if (names.empty()) {
    return absl::NotFoundError(absl::StrFormat("%s: there is no %s \"%s\"; the file names no %ss", path, what,
                                               shown_name(name), what));
  }
  return absl::NotFoundError(absl::StrFormat("%s: there is no %s \"%s\"; there are: %s", path, what,
                                             shown_name(name), name_list(names)));
}

// The pictures of an open file, from which one is chosen.
class Pictures {
 public:
  Pictures(const std::string& path, const Imf::MultiPartInputFile& file) : path_(path), file_(file) {
    for (int part = 0; part < file.parts(); ++part) {
      const Imf::Header& header = file.header(part);
      if (is_deep(header)) continue;
      const std::string name = file.parts() > 1 ? part_name(header) : "";
      for (ExrLayer& layer : layers_of(header)) add(part, name, std::move(layer));
    }
  }

  // The picture that a choice means, without notes.
  absl::StatusOr<Shown> find(const PictureChoice& choice) const {
    ASSIGN_OR_RETURN(const Candidates candidates, allowed_by(choice));
    auto shown = best_of(candidates, choice);
    if (!shown) return nothing_to_show(candidates, choice);
    return *std::move(shown);
  }

  std::vector<std::string> notes_on(const Shown& shown, const PictureChoice& choice) const {
    std::vector<std::string> notes;
    const Candidate& candidate = *shown.candidate;
    const std::string others = others_than(shown, choice);
    std::string words;
    if (file_.parts() > 1 && choice.part.empty() && (candidate.part > 0 || !others.empty())) {
      const std::string name = part_name(file_.header(candidate.part));
      words = absl::StrFormat("part %d of %d, %s,", candidate.part + 1, file_.parts(),
                              name.empty() ? "unnamed" : shown_name(name));
    }
    if (choice.layer.empty() && !candidate.layer.name.empty()) {
      absl::StrAppend(&words, words.empty() ? "" : " ", "layer ", shown_name(candidate.layer.name));
    }
    if (words.empty() && !others.empty()) words = "the picture without a layer";
    if (!words.empty()) notes.push_back(absl::StrCat(words, " is shown", others));
    if (shown.channels.xyz) notes.push_back("X, Y and Z are taken as CIE XYZ");
    return notes;
  }

 private:
  void add(int part, const std::string& part_name, ExrLayer layer) {
    Candidate candidate{.part = part, .layer = std::move(layer)};
    candidate.colour = colour_of(candidate.layer);
    candidate.data = data_of(candidate.layer);
    const std::string& view = candidate.layer.view;
    candidate.rank = rank_of_picture(part_name, candidate.layer.name, view);
    candidate.other_view = !all_.empty() && view != all_.front().layer.view;
    all_.push_back(std::move(candidate));
  }

  // The number of the part that --part names, from 0.
  absl::StatusOr<int> part_called(const std::string& choice) const {
    std::vector<std::string> names;
    for (int i = 0; i < file_.parts(); ++i) {
      const std::string name = part_name(file_.header(i));
      if (!name.empty() && is_called(name, choice)) return i;
      names.push_back(name.empty() ? absl::StrFormat("%d", i + 1) : absl::StrFormat("%d %s", i + 1, name));
    }
    // A list of parts shows a number and a name; both together are a choice, too.
    for (int i = 0; i < file_.parts(); ++i) {
      if (is_called(names[i], choice)) return i;
    }
    int number = 0;
    if (absl::SimpleAtoi(choice, &number) && number >= 1 && number <= file_.parts()) return number - 1;
    return nothing_called(path_, "part", choice, names);
  }

  absl::StatusOr<Candidates> allowed_by(const PictureChoice& choice) const {
    Candidates candidates;
    int part = -1;
    if (!choice.part.empty()) {
      ASSIGN_OR_RETURN(part, part_called(choice.part));
    }
    for (const Candidate& candidate : all_) {
      if (part < 0 || candidate.part == part) candidates.push_back(&candidate);
    }
    drop_data(choice, candidates);
    if (candidates.empty()) return nothing_to_show(candidates, choice);
    absl::Status status = keep_view(choice.view, candidates);
    if (status.ok()) status = keep_layer(choice.layer, candidates);
    if (!status.ok()) return status;
    return candidates;
  }

  // Drops the parts of data (exr_color.h), unless the user chose a part or a layer, or wants the values as
  // they stand and there are no others.
  void drop_data(const PictureChoice& choice, Candidates& candidates) const {
    if (!choice.part.empty() || !choice.layer.empty()) return;
    Candidates colour = candidates;
    std::erase_if(colour, [&](const Candidate* c) { return holds_data(file_.header(c->part)); });
    if (!colour.empty() || !choice.own_values) candidates = std::move(colour);
  }

  absl::Status keep_view(const std::string& view, Candidates& candidates) const {
    if (view.empty()) return absl::OkStatus();
    std::vector<std::string> views;
    for (const Candidate* candidate : candidates) add_once(views, candidate->layer.view);
    std::erase_if(candidates, [&](const Candidate* c) { return !is_called(c->layer.view, view); });
    return candidates.empty() ? nothing_called(path_, "view", view, views) : absl::OkStatus();
  }

  // Keeps the candidates of a layer, or else those that have a channel of this name, or else the plain
  // channels.
  absl::Status keep_layer(const std::string& layer, Candidates& candidates) const {
    if (layer.empty()) return absl::OkStatus();
    const auto keep = [&](auto matches) {
      Candidates kept;
      for (const Candidate* candidate : candidates) {
        if (matches(*candidate)) kept.push_back(candidate);
      }
      if (kept.empty()) return false;
      candidates = std::move(kept);
      return true;
    };
    if (keep([&](const Candidate& c) {
          return is_called(c.layer.name, layer) || is_called(c.layer.prefix, layer + ".");
        }) ||
        keep([&](const Candidate& c) { return channel_called(c, layer) != nullptr; }) ||
        keep([&](const Candidate& c) { return c.is_rgb(layer) || c.is_xyz(layer); })) {
      return absl::OkStatus();
    }
    return nothing_called(path_, "layer", layer, choosable(candidates));
  }

  static const std::string* channel_called(const Candidate& candidate, const std::string& choice) {
    const auto found = absl::c_find_if(candidate.layer.channels,
                                       [&](const std::string& name) { return is_called(name, choice); });
    return found == candidate.layer.channels.end() ? nullptr : &*found;
  }

  // The candidate's single channel that the choice names, and not its layer.
  static std::optional<ExrChannels> channel_of(const Candidate& candidate, const std::string& choice) {
    if (choice.empty() || is_called(candidate.layer.name, choice) ||
        is_called(candidate.layer.prefix, choice + ".")) {
      return std::nullopt;
    }
    const std::string* name = channel_called(candidate, choice);
    if (name == nullptr) return std::nullopt;
    return ExrChannels{.kind = ExrChannels::Kind::kGrey, .prefix = candidate.layer.prefix, .red = *name};
  }

  std::optional<Shown> best_of(Candidates candidates, const PictureChoice& choice) const {
    absl::c_stable_sort(candidates, [](const Candidate* a, const Candidate* b) {
      const auto order = [](const Candidate* c) {
        return std::tuple(c->rank.kind, c->other_view, c->rank.order);
      };
      return order(a) < order(b);
    });
    for (const Candidate* candidate : candidates) {
      if (auto channel = channel_of(*candidate, choice.layer)) return Shown{candidate, *std::move(channel)};
      if (candidate->is_xyz(choice.layer)) {
        Shown shown{candidate, *candidate->data};
        shown.channels.xyz = true;
        return shown;
      }
      if (candidate->colour) return Shown{candidate, *candidate->colour};
    }
    for (const Candidate* candidate : candidates) {
      if (!candidate->data) continue;
      // Without a choice, only a single channel, and only if the part has nothing else.
      if (choice.empty() && (candidate->data->kind != ExrChannels::Kind::kGrey || !is_alone(*candidate)))
        continue;
      return Shown{candidate, *candidate->data};
    }
    return std::nullopt;
  }

  bool is_alone(const Candidate& candidate) const {
    return absl::c_none_of(all_, [&](const Candidate& c) {
      return c.part == candidate.part && &c != &candidate &&
             c.layer.channels != std::vector{c.layer.prefix + "A"};
    });
  }

  // Names for --layer that show something: layers, else their channels.
  std::vector<std::string> choosable(const Candidates& candidates) const {
    std::vector<std::string> names;
    for (const Candidate* candidate : candidates) {
      if (candidate->colour || candidate->data) add_once(names, candidate->layer.name);
    }
    for (const Candidate* candidate : candidates) {
      const bool shows = candidate->colour || candidate->data;
      if (shows && !candidate->layer.name.empty()) continue;
      if (!candidate->colour && has_xyz(candidate->layer)) add_once(names, "XYZ");
      const Imf::ChannelList& channels = file_.header(candidate->part).channels();
      for (const std::string& name : candidate->layer.channels) {
        const Imf::Channel* channel = channels.findChannel(name);
        if (channel != nullptr && channel->xSampling == 1 && channel->ySampling == 1) add_once(names, name);
      }
    }
    return names;
  }

  // "; there are also --layer AO, --part 'Noisy Image'": choices that show the other pictures. "" if there
  // are none.
  std::string others_than(const Shown& shown, const PictureChoice& choice) const {
    constexpr size_t kMost = 8;
    const absl::StatusOr<Candidates> candidates = allowed_by(choice);
    if (!candidates.ok() || channel_of(*shown.candidate, choice.layer)) return "";
    std::vector<std::string> words;
    for (const Candidate* candidate : *candidates) {
      if (candidate == shown.candidate) continue;
      if (!candidate->colour && !candidate->data) continue;
      if (words.size() == kMost) {
        words.push_back("...");
        break;
      }
      const std::string advice = advice_for(*candidate, choice);
      if (!advice.empty()) add_once(words, advice);
    }
    if (words.empty()) return "";
    return absl::StrCat(words.size() == 1 ? "; there is also " : "; there are also ",
                        absl::StrJoin(words, ", "));
  }

  // The options that show this candidate beside those that the user gave; "" if there are none.
  std::string advice_for(const Candidate& candidate, const PictureChoice& given) const {
    Shown wanted{&candidate, candidate.colour ? *candidate.colour : *candidate.data};
    wanted.channels.xyz = !candidate.colour && candidate.is_xyz("XYZ");
    const std::string part = part_name(file_.header(candidate.part)),
                      number = absl::StrCat(candidate.part + 1);
    const std::string& prefix = candidate.layer.prefix;
    std::vector<std::string> parts = {""}, layers = {""};
    if (file_.parts() > 1 && given.part.empty()) parts = {shown_name(part), number, ""};
    if (given.layer.empty()) {
      layers = {"", shown_name(candidate.layer.name), shown_name(prefix.substr(0, prefix.rfind('.')))};
      layers.push_back(wanted.channels.xyz ? "XYZ" : wanted.channels.alpha.empty() ? "RGB" : "RGBA");
      for (const std::string& channel : candidate.layer.channels) {
        if (layers.size() == 8) break;
        layers.push_back(shown_name(channel));
      }
    }
    for (const std::string& one_part : parts) {
      for (const std::string& layer : layers) {
        PictureChoice choice = given;
        if (!one_part.empty()) choice.part = one_part;
        if (!layer.empty()) choice.layer = layer;
        const absl::StatusOr<Shown> found = find(choice);
        if (found.ok() && *found == wanted) return option_words(one_part, layer);
      }
    }
    return "";
  }

  // "--part 2 --layer 'Noisy Image'"
  static std::string option_words(const std::string& part, const std::string& layer) {
    const auto option = [](const char* name, const std::string& value) {
      const bool plain = absl::c_all_of(value, [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || absl::StrContains("._-+:@%,/", c) ||
               (c & 0x80) != 0;
      });
      // "=" if the value could be taken for an option.
      return absl::StrCat(
          name, value[0] == '-' ? "=" : " ",
          plain ? value : absl::StrCat("'", absl::StrReplaceAll(value, {{"'", "'\\''"}}), "'"));
    };
    std::vector<std::string> words;
    if (!part.empty()) words.push_back(option("--part", part));
    if (!layer.empty()) words.push_back(option("--layer", layer));
    return absl::StrJoin(words, " ");
  }

  absl::Status nothing_to_show(const Candidates& candidates, const PictureChoice& choice) const {
    bool deep = false;
    for (int i = 0; i < file_.parts(); ++i) deep = deep || is_deep(file_.header(i));
    if (deep && (candidates.empty() || choice.empty())) {
      return absl::UnimplementedError(
          absl::StrFormat("%s: this is a deep image, which cannot be rendered; flatten it first", path_));
    }
    if (candidates.empty() && !all_.empty()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: its colorInteropID is data, so it holds numbers and no colours; --part %d shows them as light",
          path_, all_.front().part + 1));
    }
    const std::string names = name_list(choosable(candidates));
    return absl::InvalidArgumentError(
        choice.empty()
            ? absl::StrFormat(
                  "%s: no colour channels (it has %s); it needs R G B, Y, Y RY BY or a single channel, "
                  "or name one of these with --layer",
                  path_, names)
            : absl::StrFormat("%s: nothing chosen has colour (it has %s); name one of these with --layer",
                              path_, names));
  }

  const std::string& path_;
  const Imf::MultiPartInputFile& file_;
  std::vector<Candidate> all_;
};

}  // namespace

void add_once(std::vector<std::string>& names, const std::string& name) {
  if (!name.empty() && !absl::c_linear_search(names, name)) names.push_back(name);
}

bool is_deep(const Imf::Header& header) { return header.hasType() && Imf::isDeepData(header.type()); }

absl::StatusOr<ExrPicture> choose_exr_picture(const std::string& path, const Imf::MultiPartInputFile& file,
                                              const PictureChoice& choice) {
  const Pictures pictures(path, file);
  ASSIGN_OR_RETURN(const Shown shown, pictures.find(choice));
  return ExrPicture{shown.candidate->part, shown.channels, pictures.notes_on(shown, choice)};
}

}  // namespace candela
