#include "tests/simulator/film.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/encode/image_file.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/session/environment_start.h"

namespace candela::testing {
namespace {

constexpr FrameDesc kSmall{3, 3, v1::PIXEL_FORMAT_RGBA16F};
constexpr FrameDesc kTwoBands{257, 257, v1::PIXEL_FORMAT_RGBA16F};

v1::Settings some_settings(Chance& chance) {
  v1::Settings settings;
  v1::Exposure& exposure = *settings.mutable_exposure();
  if (chance.one_in(4)) {
    exposure.set_mode(v1::Exposure::MODE_MANUAL);
    exposure.set_manual_ev(static_cast<double>(chance.below(5)));
  } else {
    exposure.set_compensation_ev(static_cast<double>(chance.below(5)));
  }
  if (chance.one_in(2)) settings.set_bad_values(v1::BAD_VALUES_REJECT);
  return settings;
}

// A scene's first word is the same in each of its frames.
std::vector<std::byte> some_pixels(Chance& chance, const FrameDesc& desc, uint64_t scene) {
  std::vector<uint64_t> words(desc.bytes() / sizeof(uint64_t));
  if (!chance.one_in(9)) {
    std::generate(words.begin(), words.end(), [&chance] { return chance.next(); });
    words[0] = scene;
    if (chance.one_in(9)) words[5] = ~uint64_t{0};
  }
  const auto bytes = std::as_bytes(std::span(words));
  return {bytes.begin(), bytes.end()};
}

// Panoramas of different sizes, the same in every history.
struct KnownPanorama {
  std::shared_ptr<const Panorama> panorama;
  std::string id;
};
const KnownPanorama& known_panorama(size_t which) {
  static const std::vector<KnownPanorama> all = [] {
    std::vector<KnownPanorama> made;
    for (uint32_t height = 1; height <= 2; ++height) {
      auto panorama = std::make_shared<Panorama>();
      panorama->start.set_width(2 * height);
      panorama->start.set_height(height);
      panorama->start.set_format(v1::PIXEL_FORMAT_RGBA16F);
      const auto bytes = std::make_shared<std::vector<std::byte>>(size_t{16} * height * height);
      panorama->pixels = *bytes;
      panorama->owner = bytes;
      made.push_back({panorama, environment_id(*panorama)});
    }
    return made;
  }();
  return all[which];
}

// The server's pixels of the frame's view.
std::vector<std::byte> view_pixels(const SessionFrame& frame) {
  Environment environment;
  identify(environment, *frame.panorama);
  return simulated_view(environment, view_from(*frame.view).value(), kSmall);
}

// Whether the image is the one that the model has for the frame.
bool is_image(const Film& film, size_t index, const RenderResult& image) {
  const std::vector<std::byte>& expected = film.answers[index].image;
  const auto equals = [&image](std::span<const std::byte> bytes) {
    return std::equal(bytes.begin(), bytes.end(), image.pixels().begin(), image.pixels().end());
  };
  if (film.options.encoding == v1::ENCODING_NONE) return equals({});
  if (film.options.encoding == v1::ENCODING_RAW) return equals(expected);
  const SimulatedFrame& frame = film.model[index];
  const PictureView picture{.width = frame.desc.width,
                            .height = frame.desc.height,
                            .rows = expected.data(),
                            .row_stride_bytes = expected.size() / frame.desc.height};
  const auto is_file = [&](bool opaque) {
    const std::string file = encode_image(picture, *frame.settings, {}, opaque, v1::ENCODING_PNG, 0).value();
    return equals(std::as_bytes(std::span(file)));
  };
  return is_file(true) || is_file(false);
}

}  // namespace

void identify(Environment& environment, const Panorama& panorama) {
  environment.radiance.emplace()[0][0] = static_cast<double>(panorama.pixels.size());
}

Film make_film(Chance& chance, const FilmPlan& plan) {
  Film film;
  SessionOptions& options = film.options;
  options.settings = some_settings(chance);
  if (chance.one_in(2)) options.lookahead = static_cast<uint32_t>(1 + chance.below(4));
  if (chance.one_in(2)) options.cut_threshold_ev = 1.0;
  if (chance.one_in(6)) options.encoding = v1::ENCODING_NONE;
  if (chance.one_in(6)) options.encoding = v1::ENCODING_PNG;
  options.return_state = chance.one_in(4);

  std::map<uint64_t, v1::Settings> settings{{0, options.settings}};  // by their first frame
  uint64_t sequence = chance.below(100);
  int64_t time_ns = static_cast<int64_t>(chance.below(1'000'000'000));
  uint64_t scene = chance.next();
  const size_t count = 1 + chance.below(plan.most_frames);
  for (size_t i = 0; i < count; ++i) {
    if (chance.one_in(5)) {
      v1::SettingsChange& change = film.changes[i];
      change.set_from_sequence(std::max(sequence + chance.below(3), settings.rbegin()->first));
      *change.mutable_settings() = some_settings(chance);
      settings[change.from_sequence()] = change.settings();
    }
    if (chance.one_in(6)) scene = chance.next();
    SessionFrame frame{.sequence = sequence, .media_time_ns = time_ns, .cut = chance.one_in(9)};
    if (chance.one_in(9)) frame.exposure = 0.5 + static_cast<double>(chance.below(8));
    FrameDesc desc = plan.large_frames && chance.one_in(400) ? kTwoBands : kSmall;
    std::vector<std::byte> pixels;
    if (plan.views && chance.one_in(2)) {
      desc = kSmall;
      const KnownPanorama& known = known_panorama(chance.below(2));
      frame.panorama = known.panorama;
      frame.view.emplace().set_environment(known.id);
      frame.view->mutable_camera()->set_yaw_deg(static_cast<double>(chance.below(360)));
      pixels = view_pixels(frame);
      film.has_views = true;
    } else {
      pixels = some_pixels(chance, desc, scene);
      auto owner = std::make_shared<std::vector<std::byte>>(pixels);
      frame.pixels = *owner;
      frame.owner = std::move(owner);
      frame.format = desc.format;
    }
    frame.width = desc.width;
    frame.height = desc.height;
    const v1::Settings& now = std::prev(settings.upper_bound(sequence))->second;
    film.settings.push_back(now);
    film.model.push_back(
        {desc, std::move(pixels), Settings::from(now).value(), sequence, time_ns, frame.cut, frame.exposure});
    film.frames.push_back(std::move(frame));
    sequence += 1 + chance.below(3);
    time_ns += static_cast<int64_t>(chance.below(100'000'000));
  }
  film.answers = undisturbed_run(film.model, options.lookahead, options.cut_threshold_ev);
  return film;
}

absl::Status check_result(const Film& film, size_t index, const FrameResult& result) {
  const auto wrong = [](const std::string& what) { return absl::DataLossError(what); };
  if (index >= film.frames.size()) return wrong("a result more than there are frames");
  const SessionFrame& frame = film.frames[index];
  const SimulatedAnswer& expected = film.answers[index];
  if (result.sequence != frame.sequence) {
    return wrong(absl::StrFormat("a result of frame %d instead of %d", result.sequence, frame.sequence));
  }
  const auto differs = [&](const std::string& what, const auto& is, const auto& should) {
    return wrong(absl::StrCat("frame ", frame.sequence, " has ", what, " ", is, " instead of ", should));
  };
  if (result.status.code() != expected.status.code()) {
    return wrong(absl::StrFormat("frame %d ends with '%s' instead of '%s'", frame.sequence,
                                 result.status.ToString(), expected.status.ToString()));
  }
  if (!result.status.ok()) return absl::OkStatus();
  const v1::ResultHeader& header = result.image.header;
  if (header.exposure() != expected.exposed.exposure) {
    return differs("exposure", header.exposure(), expected.exposed.exposure);
  }
  if (header.target() != expected.exposed.target) {
    return differs("target", header.target(), expected.exposed.target);
  }
  if (header.exposure_before() != expected.before) {
    return differs("an exposure before it of", header.exposure_before(), expected.before);
  }
  if (header.cut() != expected.cut) return differs("a cut", header.cut(), expected.cut);
  if (film.options.return_state && header.state().exposure() != expected.exposed.exposure) {
    return differs("a state of exposure", header.state().exposure(), expected.exposed.exposure);
  }
  if (!is_image(film, index, result.image)) {
    return wrong(absl::StrFormat("frame %d has another image", frame.sequence));
  }
  return absl::OkStatus();
}

}  // namespace candela::testing
