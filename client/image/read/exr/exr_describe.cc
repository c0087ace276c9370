// Describes an OpenEXR file by its headers.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfMultiView.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfTileDescription.h>

#include <cmath>

#include "absl/algorithm/container.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/image/read/exr/exr_checks.h"
#include "client/image/read/exr/exr_choice.h"
#include "client/image/read/exr/exr_color.h"
#include "client/image/read/exr/exr_file.h"
#include "client/image/read/exr/exr_rate.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

const char* compression_name(Imf::Compression compression) {
  constexpr const char* kNames[] = {"none",  "RLE", "ZIPS", "ZIP",  "PIZ",
                                    "PXR24", "B44", "B44A", "DWAA", "DWAB"};
  return compression >= 0 && compression < static_cast<int>(std::size(kNames)) ? kNames[compression]
                                                                               : "unknown";
}

std::string storage_of(const Imf::Header& header) {
  const bool deep = is_deep(header);
  if (!header.hasTileDescription()) return deep ? "deep scan lines" : "scan lines";
  const Imf::TileDescription& tiles = header.tileDescription();
  const char* levels = tiles.mode == Imf::MIPMAP_LEVELS ? ", mipmaps"
                       : tiles.mode == Imf::ONE_LEVEL   ? ""
                                                        : ", ripmaps";
  return absl::StrFormat("%s %dx%d%s", deep ? "deep tiles" : "tiles", tiles.xSize, tiles.ySize, levels);
}

WindowFacts window_of(const Imath::Box2i& box) { return {box.min.x, box.min.y, box.max.x, box.max.y}; }

ChannelFacts channel_of(const char* name, const Imf::Channel& channel) {
  const char* type = channel.type == Imf::HALF ? "half" : channel.type == Imf::FLOAT ? "float" : "uint";
  return {shown_name(name), type, channel.xSampling, channel.ySampling};
}

PartFacts part_of(const Imf::Header& header) {
  PartFacts part{.name = header.hasName() ? shown_name(header.name()) : "",
                 .storage = storage_of(header),
                 .compression = compression_name(header.compression()),
                 .display = window_of(header.displayWindow()),
                 .data = window_of(header.dataWindow()),
                 .pixel_aspect = header.pixelAspectRatio()};
  if (const std::optional<FrameRate> rate = frame_rate_of(header)) {
    part.frames_per_second = static_cast<double>(rate->frames) / static_cast<double>(rate->seconds);
  }
  if (const absl::StatusOr<ExrColor> color = exr_color("", header, {}); color.ok()) {
    part.chromaticities = color->xy;
  }
  part.color_interop_id = shown_name(color_interop_id(header));
  part.aces_container = is_aces_container(header);
  if (header.hasView()) add_once(part.views, shown_name(header.view()));
  if (Imf::hasMultiView(header)) {
    for (const std::string& view : Imf::multiView(header)) add_once(part.views, shown_name(view));
  }
  for (const ExrLayer& layer : layers_of(header)) add_once(part.layers, shown_name(layer.name));
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
    part.channels.push_back(channel_of(i.name(), i.channel()));
  }
  return part;
}

std::string shown_words(const Imf::MultiPartInputFile& file, const ExrPicture& picture) {
  const Imf::Header& header = file.header(picture.part);
  const ExrChannels& channels = picture.channels;
  std::vector<std::string> names;
  if (channels.kind == ExrChannels::Kind::kLumaChroma) {
    for (const char* name : {"Y", "RY", "BY"}) names.push_back(shown_name(channels.prefix + name));
  }
  for (const std::string& name : {channels.red, channels.green, channels.blue, channels.alpha}) {
    if (!name.empty()) names.push_back(shown_name(name));
  }
  const std::string part = file.parts() == 1
                               ? ""
                               : absl::StrFormat("part %d%s, ", picture.part + 1,
                                                 header.hasName() ? " " + shown_name(header.name()) : "");
  const char* grey = channels.kind == ExrChannels::Kind::kGrey ? " as grey" : "";
  return absl::StrCat(part, absl::StrJoin(names, " "), grey);
}

}  // namespace

absl::StatusOr<FileFacts> describe_exr(FileReader& opened, const ImageLimits& limits) {
  FileFacts facts{.kind = "OpenEXR"};
  RETURN_IF_ERROR(with_exr_file(opened, [&](Imf::MultiPartInputFile& file) {
    for (int i = 0; i < file.parts(); ++i) facts.parts.push_back(part_of(file.header(i)));
    const absl::StatusOr<ExrPicture> picture = choose_exr_picture(opened.path(), file, {});
    facts.renderable = picture.status();
    if (!picture.ok()) return absl::OkStatus();
    facts.renderable =
        check_exr_picture(opened.path(), file.header(picture->part), picture->channels, limits);
    facts.notes = picture->notes;
    if (facts.renderable.ok()) {
      const auto color = exr_color(opened.path(), file.header(picture->part), {});
      facts.renderable = color.status();
      if (color.ok()) absl::c_copy(color->notes, std::back_inserter(facts.notes));
    }
    if (facts.renderable.ok()) facts.shown = shown_words(file, *picture);
    if (!file.partComplete(picture->part)) {
      const bool luma_chroma = picture->channels.kind == ExrChannels::Kind::kLumaChroma;
      facts.notes.push_back(absl::StrCat(
          "the file is unfinished: not all of its rows or tiles were written; --incomplete fill ",
          luma_chroma ? "does not read luminance and chroma" : "renders what is there"));
    }
    return absl::OkStatus();
  }));
  return facts;
}

}  // namespace candela
