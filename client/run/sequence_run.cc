#include "client/run/sequence_run.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/write/encodings.h"
#include "client/run/exposure_file.h"
#include "client/run/file_frames.h"
#include "client/run/film.h"
#include "client/run/frame_sinks.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/picture_frame.h"
#include "client/run/report.h"
#include "client/run/server_link.h"
#include "client/run/session_run.h"
#include "client/session.h"
#include "server/base/check.h"
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

// Images of an earlier run beside the frames: then the names of all have no number in common.
absl::Status check_no_image_is_read(const Sequence& sequence, const std::optional<OutputNames>& names) {
  if (sequence.names || !names) return absl::OkStatus();
  for (const auto& [number, path] : sequence.files) {
    if (!names->may_name(path)) continue;
    return usage_error(absl::StrFormat(
        "%s looks like an image of OUT; write to another folder, or give a pattern such as in/f.%%04d.exr as "
        "IN",
        path));
  }
  return absl::OkStatus();
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
  RETURN_IF_ERROR(check_no_image_is_read(plan.sequence, plan.names));
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

namespace {

// Gives the images of a sequence to a sink. With --missing hold, a frame that has no image of its own,
// because its file is missing or bad, is held: it gets the image of the file before it.

// How a file that is not part of the sequence is rendered.
struct HeldFrameOptions {
  SessionOptions session;  // those that the sequence's session is opened with
  ImageLimits limits;
  FileFrameOptions files;              // as of the sequence's files
  std::optional<FrameRate> said_rate;  // FileFrames::said_rate()
};

class HeldFrames : public FrameSink {
 public:
  // All but `alone` must outlive this.
  HeldFrames(const StreamOptions& options, const ShotExposures& shot, const StreamPlan& plan,
             HeldFrameOptions alone, ServerLink& link, FrameSink& images, RunSummary& summary);

  // The missing frames before the first file. Call it before the others.
  absl::Status begin() { return repeat_each(sequence_.holds_before.size(), 0); }

  absl::Status image(RunFrame frame, RenderResult image) override;
  absl::Status none(RunFrame frame) override;
  absl::Status finish() override { return images_.finish(); }

 private:
  struct Rendered {
    absl::Status status;  // why the file gives no image
    RenderResult image;
    FrameFacts facts;
  };

  // Whether frames without an image get that of the file before.
  bool holds() const;
  // The missing numbers after the file with this one.
  absl::Status repeat_after(int64_t number);
  // `count` missing numbers, whose images begin at this place.
  absl::Status repeat_each(uint64_t count, uint64_t place);
  // Gives `frame` the image of the last file before it that has one. If that file is not among the chosen
  // ones, it is rendered alone, so that a part of a sequence has the images of the whole. If there is no such
  // file, the frame has no image. frame.status may say why it has none of its own. Fails if images cannot be
  // rendered or written at all, or without --skip-bad for a bad file.
  absl::Status repeat(RunFrame frame);
  absl::StatusOr<Rendered> render_alone(int64_t number, const std::string& path);
  GivenExposures exposures_of(int64_t number) const;

  const StreamOptions& options_;
  const ShotExposures& shot_;
  const Sequence& sequence_;
  const std::vector<NamedImage>& named_;
  HeldFrameOptions alone_;
  ServerLink& link_;
  FrameSink& images_;
  RunSummary& summary_;
  std::string image_of_;  // the file whose image is the last one; "": there is none
  // Files with smaller numbers are not worth a try: they are image_of_, come before it or are bad.
  int64_t next_ = -kLargestFrameNumber;
};

HeldFrames::HeldFrames(const StreamOptions& options, const ShotExposures& shot, const StreamPlan& plan,
                       HeldFrameOptions alone, ServerLink& link, FrameSink& images, RunSummary& summary)
    : options_(options),
      shot_(shot),
      sequence_(plan.sequence),
      named_(plan.images),
      alone_(std::move(alone)),
      link_(link),
      images_(images),
      summary_(summary) {
  // A frame alone has no frames after it, and another session may be open under the name.
  alone_.session.name.clear();
  alone_.session.lookahead = 0;
  alone_.session.return_state = false;
  alone_.files.skip_bad = false;
}

absl::Status HeldFrames::image(RunFrame frame, RenderResult image) {
  image_of_ = frame.facts.input;
  next_ = frame.facts.number + 1;
  const int64_t number = frame.facts.number;
  RETURN_IF_ERROR(images_.image(std::move(frame), std::move(image)));
  return repeat_after(number);
}

absl::Status HeldFrames::none(RunFrame frame) {
  const int64_t number = frame.facts.number;
  RETURN_IF_ERROR(holds() ? repeat(std::move(frame)) : images_.none(std::move(frame)));
  next_ = number + 1;
  return repeat_after(number);
}

bool HeldFrames::holds() const {
  return options_.sequence.missing == MissingFrames::kHold && options_.encoding != v1::ENCODING_NONE;
}

absl::Status HeldFrames::repeat_after(int64_t number) {
  const size_t index = sequence_.index_of(static_cast<uint64_t>(number - sequence_.zero));
  CHECK(index < sequence_.frames.size() && sequence_.frames[index].number == number);
  const SequenceFrame& file = sequence_.frames[index];
  return repeat_each(file.holds.size(), file.place + 1);
}

absl::Status HeldFrames::repeat_each(uint64_t count, uint64_t place) {
  absl::Status status;
  for (const uint64_t end = place + count; place < end && status.ok() && holds(); ++place) {
    RunFrame frame;
    frame.facts.number = named_[place].number;
    frame.facts.input = named_[place].input;
    frame.facts.place = place;
    frame.facts.media_time_ns = sequence_.media_time_ns(frame.facts.number, summary_.rate.rate);
    frame.missing = true;
    status = repeat(std::move(frame));
  }
  return status;
}

absl::Status HeldFrames::repeat(RunFrame frame) {
  FrameFacts& facts = frame.facts;
  auto file = sequence_.files.lower_bound(facts.number);
  const int64_t first = std::max(next_, sequence_.zero);
  next_ = facts.number;
  while (file != sequence_.files.begin() && std::prev(file)->first >= first) {
    --file;
    ASSIGN_OR_RETURN(Rendered rendered, render_alone(file->first, file->second));
    if (rendered.status.ok()) {
      image_of_ = file->second;
      frame.held = true;
      rendered.facts.number = facts.number;
      rendered.facts.place = facts.place;
      rendered.facts.media_time_ns = facts.media_time_ns;
      facts = std::move(rendered.facts);
      const std::string bad = bad_values_note(rendered.image.header.statistics());
      if (!bad.empty()) summary_.notes.insert(absl::StrCat(image_of_, ": ", bad));
      return images_.image(std::move(frame), std::move(rendered.image));
    }
    if (!options_.skip_bad) return rendered.status;
    summary_.notes.insert(absl::StrFormat("not repeated: %s", rendered.status.message()));
  }
  if (image_of_.empty()) {
    frame.status.Update(failure_of(
        FailureKind::kInput, absl::NotFoundError(absl::StrFormat(
                                 "frame %d is missing, and no frame before it has an image", facts.number))));
    return images_.none(std::move(frame));
  }
  frame.held = true;
  facts.input = image_of_;
  return images_.none(std::move(frame));
}

// The frame after which the session continues has the exposure of its state.
GivenExposures HeldFrames::exposures_of(int64_t number) const {
  const std::optional<int64_t> after = shot_.after();
  return after == number ? GivenExposures::locked(alone_.session.state->exposure()) : shot_.given();
}

absl::StatusOr<HeldFrames::Rendered> HeldFrames::render_alone(int64_t number, const std::string& path) {
  Sequence alone;
  alone.frames = {{.number = number, .path = path}};
  alone.zero = sequence_.zero;
  FileFrameReader reader({path}, alone_.limits, 1, choice_of(options_, alone_.files.view.get()));
  FileFrameOptions files = alone_.files;
  files.rate = summary_.rate.rate;
  files.exposures = exposures_of(number);
  FileFrames frames(alone, std::move(files), reader);
  FrameFeeder feeder(frames, /*skip_bad=*/false);
  Rendered rendered;
  rendered.status = frames.open();
  if (!rendered.status.ok()) return rendered;
  const absl::StatusOr<const v1::Settings*> first = feeder.first();
  rendered.status = first.status();
  if (!first.ok()) return rendered;
  SessionOptions options = alone_.session;
  take_input_of(**first, options.settings);
  // A session continues only with later frames.
  if (const std::optional<int64_t> after = shot_.after(); after >= number) options.state.reset();
  absl::StatusOr<Session> session = link_.open_session(options);
  if (!session.ok()) return in_options(session.status(), options_.settings);
  feeder.start(*session, options.settings);
  // The feeder uses the session until its end, which may also come by an exception.
  const absl::Cleanup stop_feeding = [&] {
    session->cancel();
    feeder.join();
  };
  absl::StatusOr<std::optional<FrameResult>> result = session->next_result();
  if (!result.ok()) return in_options(result.status(), options_.settings);
  summary_.notes.merge(feeder.take_notes());
  if (!*result) {
    feeder.join();
    rendered.status = feeder.status();
    return rendered;
  }
  rendered.status = name_file(in_options((*result)->status, options_.settings), path);
  rendered.image = std::move((*result)->image);
  rendered.facts = feeder.take_facts((*result)->sequence);
  rendered.facts.frame_rate = alone_.said_rate;
  (void)session->next_result();  // the session's end
  return rendered;
}

constexpr size_t kReadAhead = 2;

std::vector<std::string> inputs_of(const Sequence& sequence) {
  std::vector<std::string> inputs;
  for (const SequenceFrame& frame : sequence.frames) inputs.push_back(frame.path);
  return inputs;
}

// The frames' own settings. The table is the session's, and too large to copy for each of them.
v1::Settings without_table(v1::Settings settings) {
  settings.clear_table();
  return settings;
}

void describe(const Sequence& sequence, RunSummary& summary) {
  summary.frames = sequence.frames.size();
  summary.first = sequence.first();
  summary.last = sequence.last();
  summary.missing = to_text(sequence.missing);
}

// `stream` becomes the reader if it reads standard input.
std::unique_ptr<FrameReader> make_reader(const StreamOptions& options, StreamPlan& plan,
                                         const HeldFrameOptions& alone, PipedFrameReader*& stream) {
  PictureChoice choice = choice_of(options, alone.files.view.get());
  if (!options.from_stdin()) {
    return std::make_unique<FileFrameReader>(inputs_of(plan.sequence), alone.limits, kReadAhead,
                                             std::move(choice));
  }
  auto reader = std::make_unique<PipedFrameReader>(plan.sequence, plan.first, options.sequence.cuts,
                                                   alone.limits, std::move(choice));
  stream = reader.get();
  return reader;
}

std::unique_ptr<FrameSink> make_sink(const StreamOptions& options, const StreamPlan& plan, FilmFile* film,
                                     RunEvents& events, RunSummary& summary) {
  if (options.pipe) {
    const bool even = options.film && !options.film->full_chroma;
    return std::make_unique<FramePipe>(*options.pipe, summary.rate.rate, film, even, options.verbose, events,
                                       summary);
  }
  return std::make_unique<ImageFiles>(
      [&options, &plan](const FrameFacts& frame) { return output_of(options, plan, frame); }, options.write,
      events, summary);
}

absl::Status no_frame_came() {
  return input_failure(
      absl::InvalidArgumentError(absl::StrFormat(
          "%s: it ended before a frame came; look at what the program before it said", kStdinName)),
      kStdinName);
}

}  // namespace

absl::StatusOr<RunSummary> render_sequence(const StreamOptions& options, const ShotExposures& shot,
                                           StreamPlan& plan, RunEvents& events) {
  Sequence& sequence = plan.sequence;
  const bool piped = options.from_stdin();
  SessionRun run(options, events);
  RunSummary& summary = run.summary();
  RETURN_IF_ERROR(run.prepare(options.settings));
  ASSIGN_OR_RETURN(const v1::Limits limits, run.run().limits());
  HeldFrameOptions alone;
  alone.limits = image_limits(limits, options);
  alone.files = {.settings = without_table(run.session().settings),
                 .timeout = options.timeout,
                 .skip_bad = options.skip_bad,
                 .rate = shot.rate(),
                 .view = run.run().view(),
                 .ignore_empty_alpha = options.ignore_empty_alpha,
                 .desqueeze = options.desqueeze,
                 .scene_light = options.scene_light,
                 .names_primaries = options.names_primaries,
                 .defaults = options.defaults,
                 .exposures = shot.given()};
  events.begins("reading " + (piped ? kStdinName : plan.images.front().input));
  PipedFrameReader* stream = nullptr;
  const std::unique_ptr<FrameReader> reader = make_reader(options, plan, alone, stream);
  FileFrames frames(sequence, alone.files, *reader);
  if (absl::Status status = frames.open(); !status.ok()) return failure_of(FailureKind::kInput, status);
  if (piped && sequence.frames.empty()) return no_frame_came();
  summary.rate = frames.rate();
  if (shot.fixes_rate()) summary.rate.from = "exposures";
  run.session().state = shot.state();
  run.session().return_state = shot.saved();
  alone.session = run.session();
  alone.said_rate = frames.said_rate();
  std::unique_ptr<FilmFile> film;
  if (options.film) {
    const WriteOptions& write = options.write;
    ASSIGN_OR_RETURN(film, FilmFile::open(options.output, film_command(*options.film, write.transfer,
                                                                       write.hdr, FilmFile::kOutput)));
  }
  const std::unique_ptr<FrameSink> images = make_sink(options, plan, film.get(), events, summary);
  HeldFrames held(options, shot, plan, std::move(alone), run.run().link(), *images, summary);
  absl::Status status = held.begin();
  if (status.ok()) {
    status = run.render(frames, piped ? *images : held);
  } else {
    status.Update(held.finish());
  }
  if (status.ok() && stream != nullptr) status = stream->lost();
  describe(sequence, summary);
  if (!status.ok() && !summary.reader_left) return status;
  if (sequence.cut_after) summary.state.set_cut_pending(true);
  if (summary.written + summary.held == 0 && !summary.reader_left) {
    return failure_of(
        summary.skipped_for.value_or(FailureKind::kOther),
        absl::InvalidArgumentError(absl::StrFormat(
            "none of the %d frames could be rendered; run without --skip-bad to see the first failure",
            sequence.frames.size())));
  }
  if (film != nullptr) {
    events.begins("ffmpeg ends " + options.output);
    RETURN_IF_ERROR(film->finish());
  }
  summary.locked = locked_exposure(options.settings.exposure(), summary.curve);
  summary.saved = options.save_exposures;
  return std::move(summary);
}

}  // namespace candela
