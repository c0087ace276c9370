// Writes a baked environment as files that engines load.
//
// Each file appears complete or not at all. Errors have one line: those of check_environment(), and the path
// with the system's reason if a file cannot be written.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "client/environment/baked_environment.h"

namespace candela {

// A cube map with all levels as KTX 2.0, in the environment's format and handedness, not supercompressed.
// Its key/value data says what the cube map cannot, in texts with numbers as "%.9g", separated by spaces:
//   KTXorientation      rd
//   KTXwriter           candela VERSION
//   candela.handedness  left or right
//   candela.roughness   of each level, from the largest on
//   candela.sh          L_lm in the order of RadianceHarmonics: nine times R, G, B
// Every text ends with a NUL. ktx-parse, which three.js uses, gives the last three as bytes, with that NUL.
absl::Status write_ktx2(const std::string& path, const BakedEnvironment& environment);

// The same faces as OpenEXR files of halves, or floats if the texels are: FOLDER/px.exr nx py ny pz nz for
// level 0, FOLDER/level1/px.exr ... for the next ones. Creates FOLDER and its folders; FOLDER's own folder
// must exist. After a failure the files that were already written stay.
absl::Status write_face_files(const std::string& folder, const BakedEnvironment& environment);

// {"radiance": [[R, G, B] x 9], "irradiance": ...}: L_lm, and A_l L_lm as in docs/environments.md section 3.
// Every number is the shortest that gives the same float back.
absl::Status write_harmonics(const std::string& path, const RadianceHarmonics& harmonics);

}  // namespace candela
