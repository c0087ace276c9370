#include "client/cli/run_display.h"

#include "absl/strings/str_format.h"
#include "client/cli/render_report.h"
#include "client/cli/stream_report.h"

namespace candela {

void RunDisplay::progress(const RunProgress& progress) {
  const auto done = static_cast<double>(progress.done), all = static_cast<double>(progress.frames);
  const double seconds = absl::ToDoubleSeconds(progress.time);
  if (progress.frames == 0) {
    progress_.show(absl::StrFormat("%d frames, %.1f fps, exposure %s", progress.done, done / seconds,
                                   exposure_words(progress.exposure)));
    return;
  }
  progress_.show_bar(
      done / all,
      absl::StrFormat("%d/%d, %.1f fps, exposure %s, %.0f s left", progress.done, progress.frames,
                      done / seconds, exposure_words(progress.exposure), seconds / done * (all - done)));
}

void NoteDisplay::note(const std::string& note) {
  if (!quiet_) print_note_over_progress(note);
}

void RunDisplay::resumed(const SessionStats& session) {
  progress_.clear();
  if (!quiet_) print_note(resume_words(session));
}

absl::Status RunDisplay::finished(const RunFrame& frame) {
  if (!frame.status.ok() && !frame.missing) {
    progress_.clear();
    if (!quiet_) {
      print_note(absl::StrFormat("skipped: %s%s", frame.status.message(),
                                 frame.held ? "; the image before is repeated" : ""));
    }
  }
  return json_.add(to_json(frame));
}

}  // namespace candela
