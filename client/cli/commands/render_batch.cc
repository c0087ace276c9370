#include "client/cli/commands/render_batch.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/cli/terminal.h"
#include "client/image/read_formats.h"
#include "client/run/sequence.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;
using Result = absl::StatusOr<RenderReport>;

// The threads, each with one image. While one image is rendered, others are read and written; an image takes
// memory for its pixels, so there are not many.
size_t threads_for(size_t jobs) {
  const size_t wanted = std::clamp<size_t>(std::thread::hardware_concurrency(), 3, 6);
  return std::min(jobs, wanted);
}

// Takes one job after the other on several threads.
class Workers {
 public:
  Workers(const std::vector<RenderJob>& jobs, const RenderOne& render) : jobs_(jobs), render_(render) {
    for (size_t i = threads_for(jobs.size()); i > 0; --i) {
      try {
        threads_.emplace_back([this] { work(); });
      } catch (const std::system_error&) {  // the system gives no more
        if (threads_.empty()) throw;
        break;
      }
    }
  }
  ~Workers() {
    stop();
    for (std::thread& thread : threads_) thread.join();
  }

  // The result of job `index`, once it is there. Call it in order, once each.
  Result take(size_t index) {
    const absl::MutexLock lock(&mutex_);
    const auto done = [&] { return results_.contains(index); };
    mutex_.Await(absl::Condition(&done));
    return std::move(results_.extract(index).mapped());
  }

  // Begins no more jobs.
  void stop() {
    const absl::MutexLock lock(&mutex_);
    next_ = jobs_.size();
  }

 private:
  void work() {
    while (true) {
      size_t index = 0;
      {
        const absl::MutexLock lock(&mutex_);
        if (next_ >= jobs_.size()) return;
        index = next_++;
      }
      Result result = render(jobs_[index]);
      const absl::MutexLock lock(&mutex_);
      results_.emplace(index, std::move(result));
    }
  }

  Result render(const RenderJob& job) try { return render_(job); } catch (const std::exception& error) {
    const absl::Status failure = system_failure(error);
    return reworded(failure, absl::StrFormat("%s: %s", job.input, failure.message()));
  }

  const std::vector<RenderJob>& jobs_;
  const RenderOne& render_;
  absl::Mutex mutex_;
  size_t next_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<size_t, Result> results_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::thread> threads_;
};

// Reports results in order.
class Reporter {
 public:
  Reporter(const RenderOptions& options, size_t jobs, JsonOutput& json, Progress& progress)
      : options_(options), jobs_(jobs), json_(json), progress_(progress) {}

  absl::Status add(const RenderJob& job, const Result& result) {
    ++(result.ok() ? written_ : failed_);
    progress_.clear();
    absl::Status status = result.ok() ? add_image(*result) : add_failed(job, result.status());
    show();
    return status;
  }

  bool any_written() const { return written_ > 0; }

  absl::Status finish() {
    progress_.clear();
    for (const auto& [note, images] : notes_) {
      if (images > 1 && !of_run(note))
        print_note(absl::StrFormat("the same of %d more: %s", images - 1, note));
    }
    const double seconds = absl::ToDoubleSeconds(absl::Now() - begin_);
    if (!options_.quiet && !json_.to_stdout()) {
      RETURN_IF_ERROR(print(
          absl::StrFormat("%d of %d images -> %s in %.2f s\n", written_, jobs_, options_.output, seconds)));
    }
    absl::Status status = json_.write(
        line_of({{"summary",
                  {{"images", jobs_}, {"written", written_}, {"failed", failed_}, {"seconds", seconds}}}}));
    if (!status.ok() || failed_ == 0) return status;
    return failure_of(*failed_for_,
                      absl::UnknownError(absl::StrFormat("%d of %d images failed", failed_, jobs_)));
  }

 private:
  absl::Status add_image(const RenderReport& report) {
    if (!options_.quiet) {
      for (const std::string& note : notes_for_user(report)) {
        if (++notes_[note] == 1) print_note(of_run(note) ? note : report.input + ": " + note);
      }
      if (!json_.to_stdout()) {
        RETURN_IF_ERROR(print(to_text(report, options_.verbose)));
      }
    }
    return json_.add(to_json(report));
  }

  // About the options, and so the same for every image.
  bool of_run(const std::string& note) const {
    return std::find(options_.notes.begin(), options_.notes.end(), note) != options_.notes.end();
  }

  absl::Status add_failed(const RenderJob& job, const absl::Status& failure) {
    // A server's failure does not name the file.
    const bool named = absl::StartsWith(failure.message(), job.input);
    const std::string message = absl::StrCat(named ? "" : job.input + ": ", failure.message());
    add_failure(failed_for_, failure);
    print_error(reworded(failure, message));
    return json_.add(line_of({{"input", job.input},
                              {"output", job.output},
                              {"error", message},
                              {"code", exit_code(kind_of(failure))}}));
  }

  void show() {
    const size_t done = written_ + failed_;
    const double seconds = absl::ToDoubleSeconds(absl::Now() - begin_);
    const std::string failures = failed_ == 0 ? "" : absl::StrFormat(", %d failed", failed_);
    progress_.show_bar(
        static_cast<double>(done) / static_cast<double>(jobs_),
        absl::StrFormat("%d/%d%s, %.0f s left", done, jobs_, failures,
                        seconds / static_cast<double>(done) * static_cast<double>(jobs_ - done)));
  }

  const RenderOptions& options_;
  const size_t jobs_;
  JsonOutput& json_;
  Progress& progress_;
  const absl::Time begin_ = absl::Now();
  size_t written_ = 0;
  size_t failed_ = 0;
  std::optional<FailureKind> failed_for_;
  std::map<std::string, size_t> notes_;  // and how many images have each
};

// The files that one input names. A path without a pattern stays, even if nothing is there: that image fails
// by itself.
absl::StatusOr<FoundFiles> files_of_input(const std::string& input, const std::vector<std::string>& only,
                                          const std::string& output) {
  if (input == "-") {
    if (only.empty()) return FoundFiles{{input}};
    return usage_error("--only chooses among files; IN is \"-\"");
  }
  std::error_code failed;
  const bool pattern = input.find_first_of("*?[%#@") != std::string::npos;
  const bool there = std::filesystem::exists(input, failed);
  if (there ? !std::filesystem::is_directory(input, failed) : !pattern) {
    const bool taken = only.empty() || absl::c_linear_search(only, extension_of(input));
    return taken ? FoundFiles{{input}} : FoundFiles{{}, {.others = {input}}};
  }
  ASSIGN_OR_RETURN(FoundFiles found, find_frames({input}, only));
  std::erase_if(found.paths, [&](const std::string& path) {
    return !output.empty() && std::filesystem::equivalent(path, output, failed);
  });
  if (!found.paths.empty()) return found;
  return absl::NotFoundError(
      absl::StrFormat("%s: there is only %s, which is OUT; name another folder", input, output));
}

}  // namespace

absl::StatusOr<FoundFiles> files_of_inputs(const std::vector<std::string>& inputs,
                                           const std::vector<std::string>& only, const std::string& output) {
  FoundFiles all;
  std::set<std::string> seen;
  for (const std::string& input : inputs) {
    const absl::StatusOr<FoundFiles> files = files_of_input(input, only, output);
    if (!files.ok()) return input_failure(files.status(), input);
    absl::c_copy(files->left_out.hidden, std::back_inserter(all.left_out.hidden));
    absl::c_copy(files->left_out.others, std::back_inserter(all.left_out.others));
    for (const std::string& file : files->paths) {
      if (seen.insert(std::filesystem::path(file).lexically_normal().string()).second) {
        all.paths.push_back(file);
      }
    }
  }
  if (!all.paths.empty()) return all;
  return input_failure(
      absl::NotFoundError(absl::StrFormat("%s: --only takes %s files alone, and this leaves nothing",
                                          inputs.front(), absl::StrJoin(only, " and "))),
      inputs.front());
}

void print_left_out(const LeftOut& left_out) {
  if (const std::string words = words_of(left_out); !words.empty()) print_note("left out: " + words);
}

absl::StatusOr<RenderPlan> plan_render(const RenderOptions& options) {
  ASSIGN_OR_RETURN(FoundFiles files, files_of_inputs(options.inputs, options.only));
  if (options.extension.empty()) return RenderPlan{{{options.inputs.front(), options.output}}, {}};
  const std::filesystem::path folder(options.output);
  RenderPlan plan{.jobs = {}, .left_out = std::move(files.left_out)};
  std::map<std::string, std::string> outputs;  // and what becomes them
  for (const std::string& file : files.paths) {
    const std::string output = folder / (std::filesystem::path(file).stem().string() + options.extension);
    const auto [other, fresh] = outputs.emplace(output, file);
    if (!fresh) {
      const std::string kind = extension_of(other->second);
      return usage_error(absl::StrFormat(
          "%s and %s would both become %s; %s", other->second, file, output,
          kind.empty() || kind == extension_of(file)
              ? "render one of them apart"
              : absl::StrFormat("--only %s takes the first, or render one of them apart", kind.substr(1))));
    }
    plan.jobs.push_back({file, output});
  }
  return plan;
}

absl::Status render_batch(const RenderOptions& options, const std::vector<RenderJob>& jobs,
                          const RenderOne& render, const std::function<absl::Status()>& broken,
                          JsonOutput& json, Progress& progress, const std::function<absl::Status()>& last) {
  progress.show_bar(0, absl::StrFormat("0/%d", jobs.size()));
  Reporter reporter(options, jobs.size(), json, progress);
  Workers workers(jobs, render);
  for (size_t i = 0; i < jobs.size(); ++i) {
    const Result result = workers.take(i);
    if (!result.ok()) {
      RETURN_IF_ERROR(broken());
    }
    RETURN_IF_ERROR(reporter.add(jobs[i], result));
  }
  if (last && reporter.any_written()) {
    RETURN_IF_ERROR(last());
  }
  return reporter.finish();
}

}  // namespace candela
