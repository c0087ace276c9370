// The options of a run: those of the commands that render, after parsing.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/color/view_table.h"
#include "client/environment/baked_environment.h"
#include "client/image/image.h"
#include "client/image/write/piped_frames.h"
#include "client/run/film.h"
#include "client/run/sequence.h"
#include "client/security.h"
#include "client/session.h"
#include "proto/candela/v1/limits.h"

namespace candela {

// The server that renders the frames.
struct ServerChoice {
  std::string address;                   // "HOST:PORT" or "unix:PATH"; empty: the built-in server
  std::vector<std::string> others = {};  // more addresses, for a session that loses the first server
  std::string source = {};               // of the address: "--server", "from CANDELA_SERVER", ...; "": none
  ClientSecurity security = {};          // for running servers
  // The time to look for a server that takes the work, or that resumes it after a loss.
  absl::Duration resume_limit = absl::Seconds(30);
  Transport transport = Transport::kAuto;  // of sessions
  bool takes_several = false;              // the command takes a list of servers, and --resume
  bool bakes = false;                      // the command makes environments
  // Of the built-in server: a part of a Vulkan device's name, its index, or "host"; empty: a GPU, else the
  // host, but the best Vulkan device for environments and for the device's passes.
  std::string device;
  std::string executor;  // of the built-in server: "auto", "device" or "host"; empty: "auto"
};

// Which settings nobody gave.
struct PictureDefaults {
  bool exposure = false;  // 0 EV
  bool bloom = false;     // none
  // Whose default they are: that of a picture of a display, or, with a scene's light, of a view of --ocio or
  // --lut.
  PictureLight light = PictureLight::kScene;
};

// The settings of frames and the format of images.
struct PictureOptions {
  PictureChoice shown;         // of the files that hold several pictures
  uint64_t max_chunk_mib = 0;  // of an OpenEXR file; 0: as image_limits() chooses it
  uint64_t max_pixels = 0;     // of an image that is read; 0: as many as the server takes
  v1::Settings settings;  // output_format fits the output's extension; only what the user gave is present
  ViewChoice view;        // its config is empty if the user chose no view
  std::string lut;        // --lut: becomes that view's configuration
  WriteOptions write;
  bool desqueeze = false;          // images have square pixels, whatever their files' have
  std::vector<std::string> notes;  // what the user should know before the result
  // An alpha that is 0 everywhere although there is light counts as none: the output is a .png or .jpg and
  // the user chose no alpha, or it is a .png whose alpha is associated and would hide the whole picture.
  bool ignore_empty_alpha = false;
  PictureDefaults defaults;      // as they are in `settings`
  std::string sdr;               // --sdr: "base" or "curve"; "": base, unless the settings ask for a look
  bool scene_light = false;      // a picture of a display is taken as light of a scene
  bool names_primaries = false;  // the output's files can name any primaries
  std::string stdout_kind;       // the extension of an image that goes to standard output
};

// The HDR picture that a gain map of three channels leads to.
struct HdrPicture {
  v1::ToneCurve curve = v1::TONE_CURVE_UNSPECIFIED;  // BT2390 or ACES_2
  double peak_nits = 0;
};

// Whether an image is compared with the reference.
struct VerifyChoice {
  bool verify = false;
  std::string error_map;  // a .png, "" for none; only with `verify`
};

// The options that all runs have.
struct RunOptions : PictureOptions {
  ServerChoice server;
  std::string locked_exposure;  // an exposure file that gives all frames one exposure; "" for none
  std::string json;             // a path, "-" for stdout, "" for none
  bool quiet = false;
};

// A run of many frames through a session.
struct SessionRunOptions : RunOptions {
  uint32_t lookahead = 0;
  double cut_threshold_ev = 0;  // 0: no detection
  v1::Encoding encoding = v1::ENCODING_RAW;
  absl::Duration timeout = absl::InfiniteDuration();  // of a frame on the server
  std::string session;                                // its name; empty: a random one
  bool skip_bad = false;                              // frames without an image do not end it
  std::string plot;                                   // .svg, "" for none
};

struct RenderOptions : RunOptions {
  std::vector<std::string> inputs;  // files, and quoted patterns and folders; or "-", standard input
  std::vector<std::string> only;    // see find_frames()
  std::string output;               // a file, a folder, or "-", standard output
  std::string extension;            // of the images in the folder, with its dot; "" if `output` is a file
  v1::ExposureState previous;       // exposure 0: none
  VerifyChoice verify;
  // The HDR picture that the output's gain map leads to, if it has three channels. Then `settings` has no
  // gain_map_peak_nits, because the client makes this map.
  std::optional<HdrPicture> gain_map_target;
  bool verbose = false;
};

struct StreamOptions : SessionRunOptions {
  SequenceChoice sequence;
  std::string output;              // a pattern with a number, a folder, or a film; "-" for standard output
  std::optional<FilmFormat> film;  // of a film
  std::optional<PipeFormat> pipe;  // of standard output, or of what a film is made from
  bool verbose = false;            // show ffmpeg's command line
  // The number of the first image, from which the images are counted; nothing: each has its frame's number.
  std::optional<int64_t> first;
  // Exposure files, "" for none; at most one of the first two and locked_exposure.
  std::string exposures;       // gives each frame its exposure
  std::string state;           // exposure continues after its last frame
  std::string save_exposures;  // is written

  bool from_stdin() const { return sequence.inputs == std::vector<std::string>{"-"}; }
  bool to_stdout() const { return pipe && !film; }
};

// A sequence that is metered without images, or a single image. Only options of metering are used.
struct MeterOptions : StreamOptions {
  MeterOptions() { encoding = v1::ENCODING_NONE; }
};

// Views of a panorama: one picture, or a sequence if the camera moves.
struct PanoramaViewOptions : SessionRunOptions {
  PanoramaViewOptions() { camera.set_fov_deg(v1::kDefaultFovDeg); }

  std::string panorama;
  std::string output;  // a file; for a sequence a pattern with a number, or a folder
  uint32_t width = 1280;
  uint32_t height = 720;
  v1::Camera camera;  // its angles and its field of view; of a sequence, where it begins
  double rotation_deg = 0;
  uint32_t samples = v1::kDefaultViewSamples;
  std::string objects;             // "lookdev", a file, "" for none
  std::optional<double> turn_deg;  // over the whole sequence
  std::string camera_path;         // a file of keys, "" for none; not with `turn_deg`
  std::optional<uint64_t> frames;  // of a sequence
  std::optional<FrameRate> rate;
  v1::ExposureState previous;  // of a single view; exposure 0: none
  VerifyChoice verify;         // of a single view
  bool verbose = false;

  bool is_sequence() const { return turn_deg || !camera_path.empty(); }
};

// The layouts of a baked environment in files.
enum class EnvironmentLayout { kFaces, kCross, kEquirectangular };

// The cube map of a panorama. Of the settings, only the panorama's primaries, bad values and the tier count.
struct EnvironmentOptions : RunOptions {
  std::string panorama;
  std::string output;              // a .ktx2, an .exr, or a folder
  uint32_t size = 0;               // texels along a face's side; 0: by the panorama's width
  std::optional<uint32_t> levels;  // nothing: all, or one for an .exr
  v1::RoughnessMapping roughness_mapping = v1::ROUGHNESS_MAPPING_LINEAR;
  EnvironmentLayout layout = EnvironmentLayout::kFaces;
  Handedness handedness = Handedness::kLeft;
  double rotation_deg = 0;
  CubeFormat format = CubeFormat::kRgba16f;
  bool verify = false;    // measure the levels' errors
  std::string harmonics;  // a .json, "" for none
  std::string preview;    // a .png, "" for none
};

}  // namespace candela
