// Reads any bytes as either end of a Render call, as a stream's open message, as calls about environments,
// and as a session's client. wire_input.h describes the input.
#include <fcntl.h>
#include <google/protobuf/empty.pb.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/stubs/logging.h>
#include <google/protobuf/unknown_field_set.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "candela/v1/render.pb.h"
#include "client/call/result_reader.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/environment_id.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "proto/candela/v1/settings.h"
#include "server/render/plan/exposure.h"
#include "server/render/settings/settings.h"
#include "server/rpc/band_reader.h"
#include "server/session/environment_start.h"
#include "server/session/memory_region.h"
#include "server/session/render_start.h"
#include "server/session/resume_token.h"
#include "server/session/stream_start.h"
#include "tests/fuzz/expect.h"
#include "tests/fuzz/wire_input.h"
#include "tests/support/clock.h"

namespace candela {
namespace {

// A message in slices of any size. Each slice has separate memory.
grpc::ByteBuffer in_slices(const std::string& message, size_t slice_bytes) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < message.size(); at += slice_bytes) {
    slices.emplace_back(message.substr(at, slice_bytes));
  }
  return grpc::ByteBuffer(slices.data(), slices.size());
}

// Frames whose header says where they lie in a region.

constexpr uint64_t kRegionBytes = 65536;

struct Registered {
  Registered() {
    const int memfd = memfd_create("fuzz", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    expect(ftruncate(memfd, kRegionBytes) == 0, "a region has its size");
    fcntl(memfd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL);
    const auto claim = [](uint64_t) -> absl::StatusOr<std::shared_ptr<const void>> { return nullptr; };
    region = MemoryRegion::map(memfd, claim).value();
    close(memfd);
    ticket = regions.add(region).value();
  }
  MemoryRegions regions;
  std::shared_ptr<MemoryRegion> region;
  std::string ticket;
};

void expect_inside(const std::byte* begin, uint64_t bytes, const MemoryRegion& region) {
  if (begin == nullptr) return;
  const auto offset = static_cast<uint64_t>(begin - region.data());
  expect(begin >= region.data() && offset <= region.bytes() && bytes <= region.bytes() - offset,
         "an area is inside its region");
}

// Whatever the offsets, what is taken lies inside the region. `start` is what the header was checked to be.
void place_in_memory(v1::FrameHeader header, const RenderStart& start) {
  static const Registered* const kRegistered = new Registered;
  if (!header.has_memory()) return;
  if (header.memory().ticket().size() % 2 == 0) header.mutable_memory()->set_ticket(kRegistered->ticket);
  const ImageSize image = image_size(*start.settings, start.layout.desc);
  const v1::OutputFormat format = start.settings->output_format();
  const absl::StatusOr<std::optional<ClientPixels>> pixels =
      client_pixels_from(header, start.layout, image, format, /*local=*/true,
                         /*raw=*/true, kRegistered->regions);
  if (!pixels.ok()) {
    expect(absl::IsInvalidArgument(pixels.status()) || absl::IsUnavailable(pixels.status()),
           "a place is refused with one of its codes", pixels.status().ToString());
    return;
  }
  expect_inside((*pixels)->rows,
                start.layout.row_stride_bytes * (start.layout.desc.height - 1) + start.layout.row_bytes(),
                *kRegistered->region);
  expect_inside((*pixels)->image, uint64_t{image.width} * image.height * bytes_per_pixel(format),
                *kRegistered->region);
}

// The calls about environments, as the server reads them.

constexpr FrameLimits kLimits{v1::kMaxDimension, v1::kDefaultMaxFrameBytes};

void check_panorama(const PanoramaStart& start) {
  const FrameDesc& desc = start.layout.desc;
  expect(desc.width >= 1 && desc.width <= v1::kMaxPanoramaWidth, "the panorama's width is within the limits");
  expect(desc.height >= 1 && desc.height <= v1::kMaxPanoramaHeight,
         "the panorama's height is within the limits");
  expect(start.layout.row_stride_bytes >= desc.row_bytes(), "the panorama's rows hold their pixels");
}

void check_bake(const BakeStart& start) {
  const uint32_t size = start.spec.size;
  expect(size == 0 || (std::has_single_bit(size) && size >= v1::kCubeSize.min && size <= v1::kCubeSize.max),
         "a cube's size is a power of two within its range");
  expect(start.spec.quality.cube_samples > 0 && start.spec.quality.specular_detail > 0,
         "a bake has a quality");
  expect(start.format == v1::PIXEL_FORMAT_RGBA16F || start.format == v1::PIXEL_FORMAT_RGBA32F ||
             start.format == v1::PIXEL_FORMAT_RGB9E5,
         "a bake has one of its formats");
}

// Reads the messages as a PutEnvironment call.
void put_environment(const WireInput& input) {
  const std::span<const std::string> messages = input.messages;
  if (messages.empty()) return;
  grpc::ByteBuffer first = in_slices(messages[0], input.slice_bytes);
  v1::PutEnvironmentRequest request;
  if (!parse_request(first, request).ok() || !request.has_start()) return;
  const absl::StatusOr<PanoramaStart> start = panorama_start_from(request.start(), kLimits);
  if (!start.ok()) {
    expect(absl::IsInvalidArgument(start.status()) || absl::IsResourceExhausted(start.status()),
           "a panorama is refused with one of its codes", start.status().ToString());
    return;
  }
  check_panorama(*start);
  const FrameDesc& desc = start->layout.desc;
  v1::EnvironmentId id(request.start());
  BandReader reader(v1::kPanoramaBand, start->layout, testing::real_clock());
  std::vector<std::byte> place(desc.row_bytes());
  uint32_t rows = 0;
  for (const std::string& message : messages.subspan(1)) {
    grpc::ByteBuffer buffer = in_slices(message, input.slice_bytes);
    const uint32_t begin = rows;
    const absl::Status status = reader.read(buffer, [&](uint32_t y) -> std::span<std::byte> {
      // Of repeated fields the last counts, so a band may begin again.
      expect((y == rows || y == begin) && y < desc.height, "a row is the one that is due");
      rows = y + 1;
      return place;
    });
    if (!status.ok()) {
      expect(absl::IsInvalidArgument(status), "a band is refused as an invalid argument", status.ToString());
      return;
    }
    id.add(place);
  }
  expect(reader.check_complete().ok() == (rows == desc.height), "the panorama is whole with its last row");
  expect(v1::is_environment_id(id.finish()), "an id has the form of one");
}

// Reads the first message as a BakeEnvironment request, and as the header of a frame that is a view.
void use_environment(const WireInput& input) {
  if (input.messages.empty()) return;
  grpc::ByteBuffer first = in_slices(input.messages[0], input.slice_bytes);
  v1::BakeEnvironmentRequest bake;
  if (parse_request(first, bake).ok()) {
    const absl::StatusOr<BakeStart> start = bake_start_from(bake);
    if (start.ok()) check_bake(*start);
    expect(start.ok() || absl::IsInvalidArgument(start.status()), "a bake is refused with its code",
           start.status().ToString());
  }
  first = in_slices(input.messages[0], input.slice_bytes);
  v1::RenderRequest frame;
  if (!parse_request(first, frame).ok() || !frame.start().frame().has_view()) return;
  const absl::StatusOr<View> view = view_from(frame.start().frame().view());
  expect(view.ok() || absl::IsInvalidArgument(view.status()), "a view is refused with its code",
         view.status().ToString());
  if (view.ok()) expect(check_view(*view).ok(), "a view that is taken can be rendered");
}

using google::protobuf::io::CodedInputStream;

std::string bytes_of(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  expect(buffer.Dump(&slices).ok(), "a message can be looked at");
  std::string bytes;
  for (const grpc::Slice& slice : slices) {
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  }
  return bytes;
}

// Whether our codec may accept a message that the generated classes refuse. It skips the contents of the
// other members of the oneof, and unknown fields with a tag longer than five bytes.
bool may_be_looser(v1::BandKind kind, const std::string& bytes) {
  google::protobuf::Empty message;
  message.ParseFromString(bytes);
  const google::protobuf::UnknownFieldSet& fields = message.GetReflection()->GetUnknownFields(message);
  for (int i = 0; i < fields.field_count(); ++i) {
    const auto number = static_cast<uint32_t>(fields.field(i).number());
    if (number != kind.field && number <= kind.members) return true;
  }
  int high = 0;  // bytes in a row that continue a varint
  for (const char byte : bytes) {
    high = static_cast<uint8_t>(byte) >= 0x80 ? high + 1 : 0;
    if (high == 5) return true;
  }
  return false;
}

const std::string& rows_of(const v1::Band& band) {
  return !band.zstd().empty() ? band.zstd() : band.pixels();
}

grpc::ByteBuffer make_band(v1::BandKind kind, const v1::Band& band) {
  return v1::make_band(kind, band.first_row(), grpc::Slice(rows_of(band)),
                       !band.zstd().empty() ? v1::BandRows::kZstd : v1::BandRows::kPixels);
}

absl::StatusOr<v1::Band> read_band(v1::BandKind kind, const std::string& bytes, size_t slice_bytes) {
  grpc::ByteBuffer buffer = in_slices(bytes, slice_bytes);
  v1::Band band;
  const auto take = [&](CodedInputStream& input, uint64_t size, v1::BandRows form) -> absl::Status {
    expect(size <= v1::kMaxBandBytes, "a band is within its limit");
    std::string& rows = form == v1::BandRows::kZstd ? *band.mutable_zstd() : *band.mutable_pixels();
    expect(input.ReadString(&rows, static_cast<int>(size)), "the announced rows are there");
    return absl::OkStatus();
  };
  const absl::StatusOr<uint32_t> first_row = v1::read_band(kind, buffer, take);
  if (!first_row.ok()) return first_row.status();
  band.set_first_row(*first_row);
  return band;
}

// The band of that kind in a message, as the generated classes read it.
std::optional<v1::Band> parse_band(v1::BandKind kind, const std::string& bytes) {
  v1::RenderRequest request;
  v1::RenderResponse response;
  if (kind.members == v1::kFrameBand.members) {
    if (request.ParseFromString(bytes) && request.has_band()) return request.band();
  } else if (response.ParseFromString(bytes)) {
    const bool is_map = kind.field == v1::kErrorMapBand.field;
    if (is_map && response.has_error_map()) return response.error_map();
    if (!is_map && response.has_band()) return response.band();
  }
  return std::nullopt;
}

std::string serialize_band(v1::BandKind kind, const v1::Band& band) {
  v1::RenderResponse message;  // a request's band has the same bytes
  (kind.field == v1::kErrorMapBand.field ? *message.mutable_error_map() : *message.mutable_band()) = band;
  return message.SerializeAsString();
}

// Checks that our codec accepts what the generated classes accept and reads the same. Returns the band.
std::optional<v1::Band> check_codec(v1::BandKind kind, const std::string& bytes, size_t slice_bytes) {
  const absl::StatusOr<v1::Band> band = read_band(kind, bytes, slice_bytes);
  const std::optional<v1::Band> theirs = parse_band(kind, bytes);
  if (!band.ok() && absl::StrContains(band.status().message(), "send one of them")) return std::nullopt;
  if (!band.ok()) {
    expect(!theirs, "a band of the generated classes is read", band.status().ToString());
    expect(absl::IsInvalidArgument(band.status()), "what is no band is an invalid argument");
    return std::nullopt;
  }
  expect(theirs || may_be_looser(kind, bytes), "what is read is a band of the generated classes");
  if (theirs) {
    expect(band->first_row() == theirs->first_row(), "the first row is the generated classes'");
    expect(band->pixels() == theirs->pixels() && band->zstd() == theirs->zstd(),
           "the rows are the generated classes'");
  }
  if (!rows_of(*band).empty()) {
    const grpc::ByteBuffer ours = make_band(kind, *band);
    expect(bytes_of(ours) == serialize_band(kind, *band),
           "a band's bytes are those of the generated classes");
  }
  return *band;
}

// Exposes a dark, a plain and a bright frame with the settings.
void check_exposure(const v1::Exposure& settings, const std::optional<PreviousExposure>& previous) {
  for (const double mean_log2_luminance : {-40.0, 0.0, 16.0}) {
    const double target = exposure_target(settings, mean_log2_luminance);
    expect(std::isfinite(target) && target > 0, "the target is a factor", absl::StrCat(target));
    const double exposure = adapt_exposure(settings.adaptation(), previous, target);
    const double from = previous ? previous->exposure : target;
    // The last digit may be off by rounding.
    expect(
        exposure >= std::min(from, target) * (1 - 1e-12) && exposure <= std::max(from, target) * (1 + 1e-12),
        "exposure goes towards its target and not beyond", absl::StrCat(from, " ", exposure, " ", target));
  }
}

// The settings are complete: completing them once more changes nothing.
void check_settings(const Settings& settings) {
  v1::Settings again = *settings;
  expect(v1::complete_settings(again).ok(), "the settings are good");
  expect(v1::deterministic_bytes(again) == v1::deterministic_bytes(*settings), "the settings are complete");
}

void check_start(const RenderStart& start) {
  const FrameDesc& desc = start.layout.desc;
  expect(desc.width >= 1 && desc.width <= kLimits.max_dimension, "the width is within the limits");
  expect(desc.height >= 1 && desc.height <= kLimits.max_dimension, "the height is within the limits");
  expect(v1::PixelFormat_IsValid(start.layout.format) && start.layout.format != v1::PIXEL_FORMAT_UNSPECIFIED,
         "the format is one of the contract's");
  expect(desc.format == v1::with_alpha(start.layout.format), "the server keeps an alpha");
  expect(desc.bytes() <= kLimits.max_frame_bytes, "the frame is within the limits");
  const uint64_t tight = start.layout.row_bytes();
  expect(start.layout.row_stride_bytes >= tight && start.layout.row_stride_bytes <= tight + 4096,
         "the row stride is within its range");
  check_settings(start.settings);
  expect(check_settings_for(start.settings, desc, kLimits.max_dimension).ok(), "the settings suit the frame");
  if (start.given) expect(check_factor("given", *start.given).ok() && !start.previous, "it is a factor");
  if (start.previous) expect(check_previous(*start.previous).ok(), "the previous exposure is good");
  check_exposure(start.settings->exposure(), start.previous);
}

// The band's rows as the server keeps them; empty if they are damaged or do not fit.
std::vector<std::vector<std::byte>> rows_of(const v1::Band& band, const WireLayout& layout,
                                            uint32_t next_row) {
  const auto bytes = std::as_bytes(std::span(rows_of(band)));
  const uint64_t each = !band.zstd().empty() ? layout.row_bytes() : layout.row_stride_bytes;
  v1::RowUnpacker unpacker;
  uint64_t size = bytes.size();
  if (!band.zstd().empty()) size = v1::RowUnpacker::unpacked_bytes(bytes).value_or(0);
  if (size == 0 || size % each != 0 || size / each > layout.desc.height - next_row) return {};
  if (!band.zstd().empty() && !unpacker.begin(bytes, size, layout.desc.width, layout.format).ok()) return {};
  std::vector<std::byte> wire(layout.row_bytes());
  std::vector<std::vector<std::byte>> rows(size / each, std::vector<std::byte>(layout.desc.row_bytes()));
  for (uint32_t y = 0; y < rows.size(); ++y) {
    if (!band.zstd().empty()) {
      unpacker.read(y, wire);
    } else {
      std::ranges::copy(bytes.subspan(y * each, wire.size()), wire.begin());
    }
    if (layout.format == layout.desc.format) {
      rows[y] = wire;
    } else {
      v1::add_alpha(layout.format, wire, rows[y]);
    }
  }
  return rows;
}

// The server reads a start message and then bands, into rows of exactly their size.
void serve(const WireInput& input) {
  const std::span<const std::string> messages = input.messages;
  if (messages.empty()) return;
  grpc::ByteBuffer first = in_slices(messages[0], input.slice_bytes);
  v1::RenderRequest request;
  const absl::Status parsed = parse_request(first, request);
  const absl::StatusOr<RenderStart> start = parsed.ok() ? render_start_from(request, kLimits) : parsed;
  if (!start.ok()) {
    expect(absl::IsInvalidArgument(start.status()) || absl::IsResourceExhausted(start.status()),
           "a start is refused with one of its codes", start.status().ToString());
    return;
  }
  check_start(*start);
  place_in_memory(request.start().frame(), *start);

  const WireLayout& layout = start->layout;
  BandReader reader(v1::kFrameBand, layout, testing::real_clock());
  uint32_t next_row = 0;
  for (const std::string& message : messages.subspan(1)) {
    std::map<uint32_t, std::vector<std::byte>> rows;
    const auto row = [&](uint32_t y) -> std::span<std::byte> {
      expect(y >= next_row && y < layout.desc.height, "a row is one of the frame's that are still due");
      return rows.try_emplace(y, layout.desc.row_bytes()).first->second;
    };
    grpc::ByteBuffer buffer = in_slices(message, input.slice_bytes);
    const absl::Status status = reader.read(buffer, row);
    const std::optional<v1::Band> band = check_codec(v1::kFrameBand, message, input.slice_bytes);
    if (!status.ok()) {
      expect(absl::IsInvalidArgument(status), "a band is refused as an invalid argument", status.ToString());
      // The message may have contained a field that a later one replaced. Otherwise a band that fits
      // is accepted.
      if (!band || band->first_row() != next_row || rows_of(*band, layout, next_row).empty()) return;
      buffer = make_band(v1::kFrameBand, *band);
      expect(reader.read(buffer, row).ok(), "a band that fits is taken");
      return;
    }
    expect(band && band->first_row() == next_row, "a band that is taken begins where the last one ended");
    const std::vector<std::vector<std::byte>> sent = rows_of(*band, layout, next_row);
    expect(!sent.empty(), "a band that is taken is whole rows");
    for (const std::vector<std::byte>& row_sent : sent) {
      expect(rows[next_row] == row_sent, "a row holds what was sent", absl::StrCat(next_row));
      ++next_row;
    }
    expect(reader.check_complete().ok() == (next_row == layout.desc.height),
           "the frame is whole with its last row");
  }
}

// A session continues after a client's state, and gives the state back as it came.
void check_state(const StreamStart& start, const v1::SessionState& state) {
  expect(start.resume_token.empty(), "a session begins with a state or a token");
  expect(v1::deterministic_bytes(state_of(*start.state)).size() <= v1::kMaxTokenBytes, "a state is small");
  ExposureTrack track(0, start.cut_threshold_ev, *start.state);
  const v1::Exposure& settings = start.settings.settings->exposure();
  if (!track.add(state.sequence() + 1, state.media_time_ns(), false, settings).ok()) {
    expect(state.sequence() == UINT64_MAX, "a later frame follows a state");
    return;
  }
  FrameStats stats;
  stats.metered_weight = 1;
  track.metered(state.sequence() + 1, stats);
  const double exposure = track.next()->point.exposed.exposure;
  expect(check_factor("exposure", exposure).ok() || settings.mode() == v1::Exposure::MODE_MANUAL,
         "a state leads to a factor", absl::StrCat(exposure));
}

// The server reads a stream's open message and a resume token of any bytes.
void open_stream(const WireInput& input) {
  if (input.messages.empty()) return;
  grpc::ByteBuffer first = in_slices(input.messages[0], input.slice_bytes);
  v1::StreamRequest request;
  if (!parse_request(first, request).ok() || !request.has_open()) return;
  static const TokenKeys keys = *TokenKeys::random();
  expect(!keys.open(request.open().resume_token(), request.open().session(), absl::UnixEpoch()).ok(),
         "nobody else makes a token");
  const absl::StatusOr<StreamStart> start = stream_start_from(request.open());
  if (!start.ok()) {
    expect(absl::IsInvalidArgument(start.status()), "an opening is refused with its code",
           start.status().ToString());
    return;
  }
  expect(!start->session.empty() && start->session.size() <= v1::kMaxSessionNameBytes,
         "a session has a name");
  expect(start->lookahead <= v1::kLookahead.max, "the look-ahead is within its range");
  expect(start->cut_threshold_ev >= v1::kCutThresholdEv.min &&
             start->cut_threshold_ev <= v1::kCutThresholdEv.max,
         "the threshold of cuts is within its range");
  check_settings(start->settings.settings);
  if (start->state) check_state(*start, request.open().state());
}

// The client reads a header, then bands of the image and of the error map.
void receive(const WireInput& input) {
  const v1::ImageSize size{input.width, input.height};
  ResultReader reader({size, size, input.error_map, input.error_map});
  std::string image, map;
  for (size_t i = 0; i < input.messages.size(); ++i) {
    const std::string& message = input.messages[i];
    grpc::ByteBuffer buffer = in_slices(message, input.slice_bytes);
    const absl::Status status = reader.read(buffer);
    const std::optional<v1::Band> of_image = check_codec(v1::kImageBand, message, input.slice_bytes);
    const std::optional<v1::Band> of_map = check_codec(v1::kErrorMapBand, message, input.slice_bytes);
    if (!status.ok()) {
      expect(absl::IsInternal(status) || absl::IsUnimplemented(status), "a message is refused as no answer",
             status.ToString());
      return;
    }
    if (i == 0) continue;
    expect(of_image.has_value() != of_map.has_value(), "a message that is taken is a band");
    expect(!of_map || input.error_map, "a map that is taken was asked for");
    (of_image ? image : map) += of_image ? of_image->pixels() : of_map->pixels();
  }
  const absl::StatusOr<RenderResult> result = reader.take();
  if (!result.ok()) return;
  const v1::ResultHeader& header = result->header;
  expect(header.width() == input.width && header.height() == input.height,
         "the image is of the frame's size");
  expect(result->bytes % (uint64_t{input.width} * input.height) == 0, "the image is whole pixels");
  expect(std::ranges::equal(result->pixels(), std::as_bytes(std::span(image))),
         "the image holds what was sent");
  expect(std::ranges::equal(std::as_bytes(std::span(result->error_map)), std::as_bytes(std::span(map))),
         "the map holds what was sent");
}

// Checks an answer, whoever sent it; `sent` are the bytes of its bands or parts.
void check_answer(const FrameAnswer& answer, const SessionFrame& due, const std::string& sent) {
  if (!answer.status.ok()) {
    expect(answer.image.bytes == 0, "a frame that failed has no image");
    return;
  }
  const v1::ResultHeader& header = answer.image.header;
  expect(header.sequence() == due.sequence, "the result is the due frame's");
  expect(header.width() == due.width && header.height() == due.height, "the image is of the frame's size");
  expect(header.resume_token().empty(), "the token is beside the header");
  if (due.exposure) {
    expect(header.exposure() == *due.exposure && header.has_state(), "the result is what was asked for");
    expect(answer.image.bytes == 0, "a session without images has none");
    return;
  }
  expect(header.encoded_bytes() > 0 ? answer.image.bytes == header.encoded_bytes()
                                    : answer.image.bytes % (uint64_t{due.width} * due.height) == 0,
         "the image is whole");
  const auto bytes = std::as_bytes(std::span(sent));
  if (!header.alpha_left_out() || header.encoded_bytes() > 0) {
    expect(std::ranges::equal(answer.image.pixels(), bytes), "the image holds what was sent");
    return;
  }
  std::vector<std::byte> image(sent.size() / 3 * 4);
  v1::add_alpha(header.format(), bytes, image);
  expect(std::ranges::equal(answer.image.pixels(), image), "the image holds what was sent, and an alpha");
}

// The bytes that a message adds to a session's image: a band, known by its first byte, or a part of a file.
std::string image_bytes(const std::string& message, size_t slice_bytes) {
  constexpr char kBandTag = v1::kStreamImageBand.field << 3 | 2;
  if (message.starts_with(kBandTag)) {
    const absl::StatusOr<v1::Band> band = read_band(v1::kStreamImageBand, message, slice_bytes);
    return band.ok() ? band->pixels() : "";
  }
  v1::StreamResponse response;
  response.ParseFromString(message);
  return response.encoded().data();
}

// A session's client reads one answer for each frame, in order, made of the messages since the previous one.
void follow(const WireInput& input) {
  StreamReader reader({.image = !input.metered, .state = input.metered});
  const v1::ImageSize size{input.width, input.height};
  const auto due = std::make_shared<SessionFrame>(
      SessionFrame{.width = size.width, .height = size.height, .pixels = {}, .owner = {}});
  if (input.metered) due->exposure = kGivenExposure;
  std::string sent;
  bool opened = false;
  for (const std::string& message : input.messages) {
    const bool owed = due->sequence < kSessionFrames;
    grpc::ByteBuffer buffer = in_slices(message, input.slice_bytes);
    const absl::StatusOr<StreamEvent> event = reader.read(buffer, owed ? DueFrame{due, size} : DueFrame());
    if (!event.ok()) {
      expect(absl::IsInternal(event.status()) || (input.metered && absl::IsUnimplemented(event.status())),
             "a message is refused as no answer", event.status().ToString());
      return;
    }
    if (std::holds_alternative<v1::StreamOpened>(*event)) {
      expect(!opened, "a session opens once");
      opened = true;
      continue;
    }
    if (std::holds_alternative<v1::GoAway>(*event)) continue;
    expect(opened && owed, "what is taken was due, after the opening");
    sent += image_bytes(message, input.slice_bytes);
    if (const auto* answer = std::get_if<FrameAnswer>(&*event)) {
      check_answer(*answer, *due, sent);
      sent.clear();
      ++due->sequence;
    }
  }
}

}  // namespace
}  // namespace candela

// Without this, protobuf logs every string that is not UTF-8.
extern "C" int LLVMFuzzerInitialize(int*, char***) {
  google::protobuf::SetLogHandler(nullptr);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace candela;
  const WireInput input = parse_wire_input(std::string(reinterpret_cast<const char*>(data), size));
  switch (input.reader) {
    case WireInput::Reader::kServer:
      serve(input);
      open_stream(input);
      put_environment(input);
      use_environment(input);
      break;
    case WireInput::Reader::kClient:
      receive(input);
      break;
    case WireInput::Reader::kSession:
      follow(input);
      break;
  }
  return 0;
}
