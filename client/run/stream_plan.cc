#include "client/run/stream_plan.h"

#include <iterator>
#include <map>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/usage.h"
#include "client/image/encodings.h"
#include "client/run/output_files.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// All images in order, held ones included. `first` numbers them; without it they have their frames' numbers.
// Without names nothing is written, and no outputs are named.
std::vector<NamedImage> named_images(const Sequence& sequence, const std::optional<OutputNames>& names,
                                     const std::optional<int64_t>& first) {
  std::vector<NamedImage> images;
  const auto add = [&](int64_t number, const std::string& input, const std::string& name) {
    const int64_t counted = first ? *first + static_cast<int64_t>(images.size()) : number;
    images.push_back({number, input, names ? names->path(counted, name) : ""});
  };
  const auto add_missing = [&](const std::vector<int64_t>& numbers) {
    for (const int64_t number : numbers) {
      const std::string name = sequence.names ? sequence.names->path(number) : "";
      add(number, name, name);
    }
  };
  add_missing(sequence.holds_before);
  for (const SequenceFrame& frame : sequence.frames) {
    add(frame.number, frame.path, frame.path);
    add_missing(frame.holds);
  }
  return images;
}

// Refuses sequences in which two frames would become the same image, or an output would replace an input.
absl::Status check_outputs(const StreamOptions& options, const Sequence& sequence,
                           const std::vector<NamedImage>& images, const std::optional<OutputNames>& names) {
  std::map<std::string, std::string> sources;
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(),
                {options.view.config, options.exposures, options.locked_exposure, options.state});
  std::vector<OutputFile> outputs = {
      {options.json, "the JSON"}, {options.plot, "the plot"}, {options.save_exposures, "the exposures"}};
  // Any of the files may be read, because missing frames may repeat it.
  for (const auto& [number, path] : sequence.files) inputs.push_back(path);
  if (options.from_stdin()) inputs.emplace_back("/dev/stdin");
  if (options.pipe) outputs.push_back({options.output, options.film ? "the film" : "the frames"});
  for (const auto& [number, input, output] : images) {
    if (!names) continue;
    const auto [other, fresh] = sources.emplace(output, input);
    if (!fresh) {
      return usage_error(
          absl::StrFormat("%s and %s would both become %s; write to a pattern such "
                          "as out/%%04d%s",
                          other->second, input, output, names->extension()));
    }
    outputs.push_back({output, "the images"});
  }
  return check_outputs_apart(inputs, outputs);
}

// The minus of the first image will be read as a hyphen.
std::string sign_note(const OutputNames& names, const NamedImage& first) {
  return absl::StrFormat(
      "%s: its minus will be read as a hyphen, because a sign stands only at the beginning of a name and "
      "after . or _; write to a pattern such as out/%%04d%s",
      first.output, names.extension());
}

}  // namespace

absl::StatusOr<StreamPlan> plan_stream(const StreamOptions& options, const ShotExposures& shot) {
  StreamPlan plan;
  if (options.encoding != v1::ENCODING_NONE && !options.pipe) {
    ASSIGN_OR_RETURN(plan.names,
                     OutputNames::parse(options.output, output_encoding(options.encoding).extension()));
  }
  ASSIGN_OR_RETURN(const SequenceChoice choice, shot.choice());
  if (options.from_stdin()) {
    if (choice.after) plan.first = *choice.after + 1;
    plan.sequence.zero = choice.zero.value_or(plan.first);
    RETURN_IF_ERROR(check_outputs(options, plan.sequence, plan.images, plan.names));
    return plan;
  }
  absl::StatusOr<Sequence> sequence = find_sequence(choice);
  if (!sequence.ok()) {
    const std::vector<std::string>& inputs = options.sequence.inputs;
    return input_failure(sequence.status(), inputs.size() == 1 ? inputs.front() : "");
  }
  plan.sequence = *std::move(sequence);
  absl::StatusOr<std::vector<std::string>> notes = shot.check(plan.sequence);
  if (!notes.ok()) return failure_of(FailureKind::kInput, notes.status());
  std::move(notes->begin(), notes->end(), std::back_inserter(plan.sequence.notes));
  if (plan.sequence.frames.empty() && options.encoding == v1::ENCODING_NONE) {
    return failure_of(
        FailureKind::kInput,
        absl::NotFoundError(absl::StrFormat(
            "--range %s: there is no such frame to meter; give another --range", to_text(choice.range))));
  }
  plan.images = named_images(plan.sequence, plan.names, options.first);
  if (plan.names && !plan.names->keeps_sign() && options.first.value_or(plan.images.front().number) < 0) {
    plan.sequence.notes.push_back(sign_note(*plan.names, plan.images.front()));
  }
  RETURN_IF_ERROR(check_outputs(options, plan.sequence, plan.images, plan.names));
  return plan;
}

std::string output_of(const StreamOptions& options, const StreamPlan& plan, const FrameFacts& frame) {
  if (!plan.images.empty()) return plan.images.at(frame.place).output;
  if (!plan.names) return "";
  const int64_t place = static_cast<int64_t>(frame.place);
  return plan.names->path(options.first ? *options.first + place : frame.number, "");
}

}  // namespace candela
