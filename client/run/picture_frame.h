// Between image files and the wire: what a file's picture becomes as a frame, and what is noted of it.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/connection.h"
#include "client/image/image.h"
#include "client/render_result.h"
#include "client/run/baked_view.h"
#include "client/run/options.h"
#include "proto/candela/v1/image_size.h"
#include "server/encode/image_file.h"

namespace candela {

// The sizes of a frame and of its image, and the shapes of their pixels.

// Gives the settings the frame's pixel aspect, so that its image has square pixels. Says so, or why its
// pixels stay as they are.
std::string desqueeze(const Image& frame, v1::Settings& settings);

// The width of the image's pixels over their height, if the frame's have `pixel_aspect`: the image shows the
// frame's shape, unless the settings make its pixels square.
double image_pixel_aspect(v1::ImageSize frame, double pixel_aspect, const v1::OutputSize& asked);

// A note if the settings ask for another shape than the frame's; else "".
std::string shape_note(v1::ImageSize frame, const v1::OutputSize& asked);

// "480x270 of 3840x2160", or "3840x2160" if the frame has that size.
std::string size_words(v1::ImageSize image, v1::ImageSize frame);

// A frame's alpha in the command: the treatment that an image gets by default.

// Some renderers and games leave alpha 0 everywhere although there is light. Then it means nothing: such a
// frame is taken as opaque, and this says so. The frame's own values decide, before anything is exposed or
// quantised: a dark or faint frame with some alpha keeps it. `frame` is as read_image() returns it, halves or
// floats. Returns a note for the user; empty if nothing changed. Call it only if PictureOptions or
// MeterOptions say ignore_empty_alpha.
std::string ignore_empty_alpha(const Image& frame, v1::Settings& settings);

// Which primaries a frame's values are taken as, and who said so. Every result tells the user.

struct PrimariesUsed {
  enum class Source {
    kAssumed,
    kFile,
    kOption,  // --primaries
    kView,    // --ocio-input names a colour space
    kValues   // none are used: a view of data shows the file's values
  };
  Source source = Source::kAssumed;
  std::array<float, 8> xy{};  // CIE 1931 xy of red, green, blue and white; of kView and kValues not used
  std::string space{};        // of kView
};

// `given` are the settings as the user gave them, whose primaries come before the file's.
PrimariesUsed primaries_used(const Image& image, const v1::Settings& given);

// "Rec.709, assumed"; "AP1, from the file"; "Rec.2020, from --primaries"; "ACEScct, from --ocio-input"; "the
// file's own values". Primaries without a name are given as numbers.
std::string words_of(const PrimariesUsed& primaries);

// {name (null if they have none), xy [8] (null if they are not used), from: "assumed", "file", "option",
// "ocio-input" or "values"}
nlohmann::ordered_json to_json(const PrimariesUsed& primaries);

// What the user should know about a frame or its picture, in one sentence each; "" if there is nothing to
// say.

// A sentence if more than 1 % of the image's R, G and B components lie outside of the gamut of the curve,
// with what to do about it; of a finished SDR picture if any do. `settings` are those that were sent, and
// `names_primaries` is as in PictureOptions.
std::optional<std::string> gamut_note(const v1::ResultHeader& result, const v1::Settings& settings,
                                      PictureLight light, bool names_primaries);

// "exposure held at --max-exposure 64; it would have been 812", if a limit held it; else empty. Both factors
// are those of a result; a server that does not know the second leaves it 0.
std::string held_words(double target, double target_before_limits);

// Says what became of values that were no numbers or beyond 2^30; "" if there were none.
std::string bad_values_note(uint64_t nan, uint64_t infinite, uint64_t clamped);
// The same of a frame or a panorama. `counted` is the message that counts them.
template <typename Message>
std::string bad_values_note(const Message& counted) {
  return bad_values_note(counted.nan_components(), counted.infinite_components(),
                         counted.clamped_components());
}

// A note for who renders a picture that its file calls a cube map as a frame; "" if it is none.
std::string cube_map_note(const Image& image);

// Converts between image files and frames on the wire.

// The wire format of an image as a reader returns it.
v1::PixelFormat wire_format(ImageFormat format);

// The limits for reading images for a server: what it takes, and no more pixels than the options allow. A
// chunk of an OpenEXR file may take options.max_chunk_mib, or an eighth of the memory that this process may
// use if that is 0.
ImageLimits image_limits(const v1::Limits& server, const PictureOptions& options);

// The same without a server.
ImageLimits default_image_limits();

// A view of the image's pixels; the image must outlive it.
FrameView view_of(const Image& image);

// Whether the user says what the primaries of the input are.
bool has_primaries(const v1::Settings& settings);

// CIE xy of red, green, blue and white.
v1::Chromaticities to_message(const std::array<float, 8>& xy);

// How a picture is sent.
struct PictureSettings {
  v1::Settings settings;
  PictureDefaults defaults;
  // The image's, if it keeps the picture's own: then `settings` has no primaries.
  std::optional<std::array<float, 8>> kept_primaries;
};
// What else than the given settings decides it.
struct PictureFacts {
  std::optional<double> exposure = {};  // the frame's, if it is given
  bool adapts = false;                  // the exposure follows one before
  PictureDefaults defaults = {};        // of the given settings
  bool names_primaries = false;         // as in PictureOptions
};

// Light of a display is shown as it is: at 0 EV, without bloom, and by a curve that leaves it alone, up to
// half of white if it is brighter than the display. Each of these settings only if it has no value, and the
// exposure only if the facts do not decide it. Returns the defaults of the settings then.
PictureDefaults show_as_it_is(PictureLight light, double peak, const PictureFacts& facts,
                              v1::Settings& settings);

// By show_as_it_is(), and with the chromaticities of the file unless the user set some.
PictureSettings settings_for(const Image& image, const v1::Settings& given, const PictureFacts& facts);

// Refuses a gain map beside an SDR picture, the file `path`, which has no light for it. `asked`: --gain-map
// is given.
absl::Status check_light_for_gain_map(const std::string& path, PictureLight light, bool asked);

// A note if the settings say how to meter, and a picture of a display is not metered; else "".
std::string not_metered_note(const Image& image, const v1::Settings& given, const PictureDefaults& defaults);

// How the image of this result is written: an HDR one says how bright it is, and a JPEG may have a gain map.
WriteOptions write_options_for(WriteOptions options, const v1::ResultHeader& result,
                               const std::optional<std::array<float, 8>>& kept_primaries);

// Makes an image to write from a raw result. Alpha and pixel aspect come from the input file.
Image picture_of(RenderResult result, bool has_alpha, double pixel_aspect);

// Says which input failed, and puts its path before a server's refusal, which does not know it.
absl::Status name_file(const absl::Status& status, const std::string& path);

// As what an image that choice_of() chose is rendered.
PrimariesUsed primaries_of(const Image& image, const v1::Settings& given, const BakedView* view);

}  // namespace candela
