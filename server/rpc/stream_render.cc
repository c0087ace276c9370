// A stream's frames once they are received: metered, drawn and encoded.
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "server/base/status_macros.h"
#include "server/encode/image_file.h"
#include "server/rpc/stream_call.h"
#include "server/schedule/frame_metrics.h"

namespace candela {
namespace {

PictureView picture_of(const FrameMemory& memory, bool wide) {
  const std::span<const std::byte> first = memory.output_row(0);
  const uint32_t height = memory.image().height;
  return {.width = memory.image().width,
          .height = height,
          .wide = wide,
          .rows = first.data(),
          .row_stride_bytes =
              height == 1 ? first.size() : static_cast<size_t>(memory.output_row(1).data() - first.data())};
}

}  // namespace

absl::Status StreamCall::submit(const EntryPtr& entry, Work work) {
  FrameJob job{.frame = entry->frame, .work = work, .flow = flow_};
  // A frame that took part in the exposure of others is rendered even if it is late.
  if (work != Work::kDraw) job.deadline = entry->deadline;
  if (work == Work::kRender) {
    // The render thread does not wait for mutex_, under which messages are read.
    job.decide = [self = self(), entry, frames = &open_->frames](const FrameStats& stats) {
      return frames->decide(*entry, stats);
    };
  } else if (work == Work::kDraw) {
    job.decide = [exposed = entry->exposure.exposed](const FrameStats&) { return exposed; };
  }
  job.done = [self = self(), entry, work](absl::StatusOr<RenderedFrame> rendered) {
    self->on_worked(entry, work, std::move(rendered));
  };
  ASSIGN_OR_RETURN(const Ticket ticket, state_.rendering.loop.submit(std::move(job)));
  SessionFrames::submitted(*entry, work, ticket);
  return absl::OkStatus();
}

absl::Status StreamCall::submit_decided() {
  while (const EntryPtr entry = open_->frames.next_decided()) {
    if (!open_->session.start.draws()) {
      state_.metrics.frame_ended(absl::StatusCode::kOk);
      ++state_.rendering.frames_rendered;
      continue;
    }
    RETURN_IF_ERROR(submit(entry, Work::kDraw));
  }
  return absl::OkStatus();
}

void StreamCall::on_worked(const EntryPtr& entry, Work work, absl::StatusOr<RenderedFrame> rendered) {
  if (rendered.ok()) count_stages(state_.metrics, *rendered);
  if (rendered.ok() && work != Work::kMeter) ++state_.rendering.frames_rendered;
  // These outlive the lock, because freeing a frame's memory takes time.
  std::shared_ptr<Frame> freed;
  FrameMemory freed_memory;
  absl::MutexLock lock(&mutex_);
  if (entry->dropped) {
    freed = std::move(entry->frame);
    return;
  }
  absl::Status status = rendered.status();
  if (!status.ok()) log_failure(*entry, status);
  if (rendered.ok() && work == Work::kMeter) {
    open_->frames.metered(*entry, *std::move(rendered));
    if (!open_->session.start.draws()) freed_memory = std::move(entry->frame->memory);
    status = submit_decided();
  } else if (rendered.ok()) {
    on_rendered(entry, *std::move(rendered));
  } else if (open_->frames.fail(*entry, status)) {
    freed = std::move(entry->frame);
    state_.metrics.frame_ended(status.code());
    status = submit_decided();
  }
  if (!status.ok()) end_without(open_->frames.end_before(*entry), status);
  write_on();
}

void StreamCall::on_rendered(const EntryPtr& entry, RenderedFrame rendered) {
  const StreamStart& start = open_->session.start;
  const bool encode = start.encoding != v1::ENCODING_RAW;
  SessionFrames::rendered(*entry, std::move(rendered), encode);
  if (!encode) return state_.metrics.frame_ended(absl::StatusCode::kOk);
  state_.rendering.encoders.run([self = self(), entry, image = entry->frame,
                                 opaque = entry->report->plan.resolve.opaque, shown = entry->report->shown,
                                 gain = entry->report->plan.gain, encoding = start.encoding,
                                 quality = start.jpeg_quality] {
    const absl::Time begin = self->clock_.now();
    const v1::Settings& settings = *image->settings;
    const bool wide = settings.output_format() == v1::OUTPUT_FORMAT_RGBA16;
    ImageFacts facts;
    if (shown) {
      const double peak = settings.peak_nits();
      facts.hdr = hdr_display(settings, shown->largest * peak, shown->mean * peak);
    }
    if (gain) facts.gain_map_max_log2 = gain->max_log2();
    absl::StatusOr<std::string> file =
        encode_image(picture_of(image->memory, wide), settings, facts, opaque, encoding, quality);
    if (file.ok()) image->memory.replace_output(file->size());
    self->on_encoded(entry, std::move(file), self->clock_.now() - begin);
  });
}

void StreamCall::on_encoded(const EntryPtr& entry, absl::StatusOr<std::string> file, absl::Duration took) {
  absl::MutexLock lock(&mutex_);
  if (entry->dropped) return;
  if (!file.ok()) {
    log_failure(*entry, file.status());
    end_without(open_->frames.end_before(*entry), file.status());
  } else {
    SessionFrames::encoded(*entry, *std::move(file), took);
    state_.metrics.stage("encode", took);
    state_.metrics.frame_ended(absl::StatusCode::kOk);
  }
  write_on();
}

}  // namespace candela
