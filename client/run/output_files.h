// The files that a command writes: checked before the work, so that none of them replaces an input.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

struct OutputFile {
  std::string path;  // "" is no file and always good
  std::string what;  // in the user's words: "the image", "the JSON"
};

// The files that the options of a server name: certificates, keys and the token. "" where one is not given.
std::vector<std::string> files_of(const ServerChoice& server);

// Refuses an output that is one of the inputs, and two outputs that are one file. Files are the same if their
// device and inode are, so links and other spellings of a path do not hide it; a file that does not exist yet
// is known by its path without links. "-" is the file that stdout leads to. Pipes and devices are good.
// Inputs that are "" or not there are ignored. A usage error that names both.
absl::Status check_outputs_apart(const std::vector<std::string>& inputs,
                                 const std::vector<OutputFile>& outputs);

// Whether the file begins as JSON does. True of an empty file, too.
bool holds_json(const std::string& path);
// A usage error if this option's file is there and holds no JSON, such as an image that was named by mistake.
absl::Status replaces_only_json(const char* option, const std::string& path);

// Whether a path is that of a folder: it ends in "/", or a folder is there.
bool names_folder(const std::string& path);

// Makes the folder of a file to write if it is missing. Fails with the folder and the system's reason.
absl::Status make_folder_of(const std::string& path);

// The same for a folder itself.
absl::Status make_folder(const std::string& folder);

// Removes the folders that this process made and that are empty, for a command that failed.
void remove_empty_folders();

}  // namespace candela
