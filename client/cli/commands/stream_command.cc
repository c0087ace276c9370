#include <OpenEXR/ImfThreading.h>
#include <sys/stat.h>

#include <algorithm>
#include <deque>
#include <future>
#include <map>
#include <new>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/commands/stream_report.h"
#include "client/cli/files/frame_feeder.h"
#include "client/cli/files/frame_files.h"
#include "client/cli/files/frame_reader.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/sequence_files.h"
#include "client/cli/files/terminal.h"
#include "client/image/write/atomic_file.h"

namespace candela {
namespace {

constexpr size_t kReadAhead = 2;
constexpr size_t kMostNotes = 5;

absl::StatusOr<std::vector<std::string>> write_bytes(const std::string& path, const RenderResult& result) {
  absl::StatusOr<AtomicFile> file = AtomicFile::create(path);
  if (!file.ok()) return file.status();
  file->write(result.data.get(), result.bytes);
  if (absl::Status status = file->commit(); !status.ok()) return status;
  return std::vector<std::string>();
}

absl::StatusOr<std::vector<std::string>> write_result(const std::string& path, const RenderResult& result,
                                                      const FrameFacts& facts,
                                                      const WriteOptions& options) try {
  if (result.header.encoded_bytes() > 0) return write_bytes(path, result);
  const absl::StatusOr<Image> picture = picture_of(result, facts.has_alpha, facts.pixel_aspect);
  if (!picture.ok()) return picture.status();
  return write_image(path, *picture, options);
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(absl::StrFormat("%s: out of memory", path));
}

// Renders a sequence: feeds its files to a session and writes the results, several at once.
class Streaming {
 public:
  Streaming(const StreamOptions& options, const std::vector<std::string>& paths, const OutputNames& names,
            JsonOutput& json, Progress& progress)
      : options_(options),
        paths_(paths),
        names_(names),
        json_(json),
        progress_(progress),
        link_(options.server) {}

  absl::StatusOr<StreamSummary> run() {
    summary_.frames = paths_.size();
    SessionOptions session;
    if (absl::Status status = prepare(session.settings); !status.ok()) return status;
    const absl::StatusOr<v1::Limits> limits = link_.limits();
    if (!limits.ok()) return limits.status();
    progress_.show("reading " + paths_.front());
    FrameReader reader(paths_,
                       {.max_dimension = limits->max_dimension(), .max_bytes = limits->max_frame_bytes()},
                       kReadAhead);
    FrameFeeder feeder(options_, reader);
    const absl::StatusOr<const Image*> first = feeder.first();
    if (!first.ok()) return first.status();
    absl::Status status;
    if (*first != nullptr) {
      status = stream(**first, std::move(session), feeder);
    }
    add_skipped(feeder, paths_.size());
    while (!writing_.empty()) status.Update(finish_oldest());
    status.Update(feeder.status());
    if (!status.ok()) return status;
    if (summary_.written == 0) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "none of the %d frames could be rendered; run without --skip-bad to see the first failure",
          paths_.size()));
    }
    return std::move(summary_);
  }

 private:
  // A frame with its image being written, or a frame without an image.
  struct Writing {
    StreamFrame frame;
    std::future<absl::StatusOr<std::vector<std::string>>> written;  // invalid if nothing is written
  };

  absl::Status prepare(v1::Settings& settings) {
    settings = options_.settings;
    if (!options_.view.config.empty()) {
      progress_.show("baking " + options_.view.config);
      absl::StatusOr<BakedView> baked = bake(options_.view);
      if (!baked.ok()) return baked.status();
      *settings.mutable_table() = std::move(baked->table);
      summary_.notes.insert(baked->notes.begin(), baked->notes.end());
    }
    return link_.check_tier(settings.tier());
  }

  absl::Status stream(const Image& first, SessionOptions options, FrameFeeder& feeder) {
    options.settings = settings_for(first, std::move(options.settings));
    options.name = options_.session;
    options.lookahead = options_.lookahead;
    options.cut_threshold_ev = options_.cut_threshold_ev;
    options.encoding = options_.encoding;
    options.jpeg_quality = static_cast<uint32_t>(options_.write.jpeg_quality);
    options.resume_limit = options_.resume_limit;
    progress_.show("opening a session");
    absl::StatusOr<Session> session = link_.open_session(options);
    if (!session.ok()) return session.status();
    begin_ = absl::Now();
    feeder.start(*session, options.settings);
    absl::Status status = take_results(*session, feeder);
    if (!status.ok()) session->cancel();
    // The feeder ends after the last file, or when submit() fails.
    feeder.join();
    while (status.ok() && !writing_.empty()) status = finish_oldest();
    summary_.time = absl::Now() - begin_;
    summary_.session = session->stats();
    summary_.notes.merge(feeder.take_notes());
    return status;
  }

  absl::Status take_results(Session& session, FrameFeeder& feeder) {
    while (true) {
      absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
      if (!result.ok()) return result.status();
      if (!*result) return absl::OkStatus();
      tell_of_resume(session);
      FrameResult& frame = **result;
      add_skipped(feeder, frame.sequence);
      if (absl::Status status = take(frame, feeder.take_facts(frame.sequence)); !status.ok()) return status;
      show(frame.sequence);
    }
  }

  absl::Status take(FrameResult& result, const FrameFacts& facts) {
    const std::string& input = paths_[result.sequence];
    StreamFrame frame = frame_of(result.sequence);
    frame.status = result.status;
    if (!result.status.ok()) {
      if (!options_.skip_bad) return name_file(result.status, input);
      writing_.push_back({std::move(frame), {}});
      return keep_bounded();
    }
    frame.header = result.image.header;
    frame.latency = result.latency;
    exposure_ = frame.header.exposure();
    summary_.curve.push_back({static_cast<double>(frame.media_time_ns) * 1e-9, exposure_,
                              frame.header.target(), frame.header.statistics().mean_log2_luminance(),
                              frame.header.cut()});
    const std::string path = frame.output;
    writing_.push_back({std::move(frame),
                        std::async(std::launch::async, [this, path, facts, image = std::move(result.image)] {
                          return write_result(path, image, facts, options_.write);
                        })});
    return keep_bounded();
  }

  StreamFrame frame_of(uint64_t index) const {
    StreamFrame frame;
    frame.index = index;
    frame.input = paths_[index];
    frame.output = names_.path(options_.first + index, paths_[index]);
    frame.media_time_ns = media_time_ns(index, options_.fps);
    return frame;
  }

  void add_skipped(FrameFeeder& feeder, uint64_t before) {
    for (auto& [index, status] : feeder.take_skipped(before)) {
      StreamFrame frame = frame_of(index);
      frame.status = std::move(status);
      writing_.push_back({std::move(frame), {}});
    }
  }

  absl::Status keep_bounded() {
    const size_t most = std::max<size_t>(2, std::thread::hardware_concurrency());
    absl::Status status;
    while (status.ok() && writing_.size() > most) status = finish_oldest();
    return status;
  }

  // Waits until the oldest image is written, and reports it.
  absl::Status finish_oldest() {
    Writing oldest = std::move(writing_.front());
    writing_.pop_front();
    if (oldest.written.valid()) {
      absl::StatusOr<std::vector<std::string>> notes = oldest.written.get();
      if (!notes.ok()) return notes.status();
      summary_.notes.insert(notes->begin(), notes->end());
      ++summary_.written;
      summary_.latency += oldest.frame.latency;
    } else {
      ++summary_.skipped;
      progress_.clear();
      if (!options_.quiet) print_note("skipped: " + std::string(oldest.frame.status.message()));
    }
    return json_.add(to_json(oldest.frame));
  }

  void tell_of_resume(const Session& session) {
    const SessionStats stats = session.stats();
    if (stats.resumes == resumes_) return;
    resumes_ = stats.resumes;
    progress_.clear();
    if (options_.quiet) return;
    // The rest of the message tells the user what to do, which the session has done.
    const std::string loss(stats.last_loss.message());
    print_note(absl::StrFormat("%s; resumed on %s after %.2f s without losing a frame",
                               loss.substr(0, loss.find(';')), stats.server,
                               absl::ToDoubleSeconds(stats.time_without_results)));
  }

  void show(uint64_t index) {
    const auto done = static_cast<double>(index + 1);
    const auto all = static_cast<double>(paths_.size());
    const double seconds = absl::ToDoubleSeconds(absl::Now() - begin_);
    progress_.show_bar(done / all, absl::StrFormat("%d/%d, %.1f fps, %s, %.0f s left", index + 1,
                                                   paths_.size(), done / seconds, exposure_words(exposure_),
                                                   seconds / done * (all - done)));
  }

  const StreamOptions& options_;
  const std::vector<std::string>& paths_;
  const OutputNames& names_;
  JsonOutput& json_;
  Progress& progress_;
  ServerLink link_;
  StreamSummary summary_;
  absl::Time begin_;
  std::deque<Writing> writing_;
  double exposure_ = 1;
  uint64_t resumes_ = 0;
};

// Identifies a file independently of its path.
using FileId = std::pair<dev_t, ino_t>;
std::optional<FileId> file_id(const std::string& path) {
  struct stat about {};
  if (stat(path.c_str(), &about) != 0) return std::nullopt;
  return FileId{about.st_dev, about.st_ino};
}

// Refuses sequences in which two frames would become the same image, or an image would overwrite a frame.
absl::Status check_outputs(const StreamOptions& options, const std::vector<std::string>& paths,
                           const OutputNames& names) {
  std::set<FileId> frames;
  for (const std::string& path : paths) {
    if (const std::optional<FileId> frame = file_id(path)) frames.insert(*frame);
  }
  std::map<std::string, std::string> inputs;
  for (size_t i = 0; i < paths.size(); ++i) {
    const std::string output = names.path(options.first + i, paths[i]);
    const auto [other, fresh] = inputs.emplace(output, paths[i]);
    if (!fresh) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s and %s would both become %s; write to a pattern such "
                          "as out/%%04d%s",
                          other->second, paths[i], output, names.extension()));
    }
    if (const std::optional<FileId> there = file_id(output); there && frames.contains(*there)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s is one of the frames; write the images to another folder", output));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status run_stream(const StreamOptions& options) {
  const bool jpeg = options.encoding == v1::ENCODING_JPEG;
  const absl::StatusOr<OutputNames> names = OutputNames::parse(options.output, jpeg ? ".jpg" : ".png");
  if (!names.ok()) return names.status();
  const absl::StatusOr<std::vector<std::string>> paths = find_frames(options.inputs);
  if (!paths.ok()) return paths.status();
  if (absl::Status status = check_outputs(options, *paths, *names); !status.ok()) return status;
  if (!options.plot.empty()) {
    if (absl::Status status = check_plot(options.plot); !status.ok()) return status;
  }
  absl::StatusOr<JsonOutput> json = JsonOutput::open(options.json);
  if (!json.ok()) return json.status();
  if (absl::Status status = names->make_folder(); !status.ok()) return status;
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  absl::StatusOr<StreamSummary> summary = Streaming(options, *paths, *names, *json, progress).run();
  progress.clear();
  if (!summary.ok()) return summary.status();
  if (!options.plot.empty()) {
    if (absl::Status status = plot_exposure(summary->curve, options.plot); !status.ok()) return status;
  }
  if (!options.quiet) {
    summary->notes.insert(options.notes.begin(), options.notes.end());
    size_t told = 0;
    for (const std::string& note : summary->notes) {
      if (told++ < kMostNotes) print_note(note);
    }
    if (told > kMostNotes) print_note(absl::StrFormat("and %d more notes", told - kMostNotes));
    if (!json->to_stdout()) {
      const std::string where =
          absl::StrFormat("%s .. %s", names->path(options.first, paths->front()),
                          names->path(options.first + paths->size() - 1, paths->back()));
      if (absl::Status status = print(to_text(*summary, where)); !status.ok()) return status;
    }
  }
  if (absl::Status status = json->add(to_json(*summary)); !status.ok()) return status;
  return json->close();
}

}  // namespace candela
