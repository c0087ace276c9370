// The input of fuzz_wire: one Render call as the server or the client reads it, or a session as the client
// reads it.
//   byte 0     bit 0: the client reads, not the server; bit 1: the client requested an error map;
//              bit 2: a session's client reads, regardless of bit 0; bit 3: the session has no images, its
//              results hold states, and its frames bring the exposure kGivenExposure
//   byte 1     gRPC's slices of messages have this many bytes, 0 for 256
//   bytes 2, 3 width and height of the client's frame, minus 1; a session has kSessionFrames frames
//   then messages, each after its length in two bytes, low byte first; the last may be cut short
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace candela {

// The number of a session's frames that wait for results; their sequence numbers are 0, 1, ...
inline constexpr uint64_t kSessionFrames = 3;
inline constexpr double kGivenExposure = 0.3;

struct WireInput {
  enum class Reader { kServer, kClient, kSession };
  Reader reader = Reader::kServer;
  bool error_map = false;             // the client requested one
  bool metered = false;               // see bit 3 above
  size_t slice_bytes = 256;           // 1 .. 256
  uint32_t width = 1;                 // 1 .. 256
  uint32_t height = 1;                // 1 .. 256
  std::vector<std::string> messages;  // each below 64 KiB
};

inline WireInput parse_wire_input(const std::string& bytes) {
  const auto byte = [&](size_t i) -> size_t { return i < bytes.size() ? static_cast<uint8_t>(bytes[i]) : 0; };
  WireInput input;
  input.reader = byte(0) % 2 == 0 ? WireInput::Reader::kServer : WireInput::Reader::kClient;
  if ((byte(0) & 4) != 0) input.reader = WireInput::Reader::kSession;
  input.error_map = byte(0) & 2;
  input.metered = (byte(0) & 8) != 0;
  input.slice_bytes = byte(1) == 0 ? 256 : byte(1);
  input.width = static_cast<uint32_t>(byte(2)) + 1;
  input.height = static_cast<uint32_t>(byte(3)) + 1;
  for (size_t at = 4; at + 2 <= bytes.size();) {
    const size_t length = byte(at) | byte(at + 1) << 8;
    input.messages.push_back(bytes.substr(at + 2, length));
    at += 2 + length;
  }
  return input;
}

inline std::string format_wire_input(const WireInput& input) {
  const int bits = (input.reader == WireInput::Reader::kClient ? 1 : 0) | (input.error_map ? 2 : 0) |
                   (input.reader == WireInput::Reader::kSession ? 4 : 0) | (input.metered ? 8 : 0);
  std::string bytes{static_cast<char>(bits), static_cast<char>(input.slice_bytes),
                    static_cast<char>(input.width - 1), static_cast<char>(input.height - 1)};
  for (const std::string& message : input.messages) {
    bytes.push_back(static_cast<char>(message.size() & 255));
    bytes.push_back(static_cast<char>(message.size() >> 8));
    bytes += message;
  }
  return bytes;
}

}  // namespace candela
