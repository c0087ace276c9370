#include "server/access/client_identity.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "server/base/digest.h"

namespace candela {
namespace {

constexpr size_t kNetworkBytes = 8;     // of an IPv6 address; the others name the host
constexpr size_t kHashBytes = 16;       // of what names a credential
constexpr size_t kMappedPrefix = 12;    // of an IPv4 address in an IPv6 address
constexpr size_t kMaxForwarded = 4096;  // bytes of x-forwarded-for that are looked at, from its end

std::string text_of(const in_addr& address) {
  char text[INET_ADDRSTRLEN];
  return inet_ntop(AF_INET, &address, text, sizeof text);
}

std::string network_of(in6_addr address) {
  if (IN6_IS_ADDR_V4MAPPED(&address)) {
    in_addr mapped;
    std::memcpy(&mapped, address.s6_addr + kMappedPrefix, sizeof mapped);
    return text_of(mapped);
  }
  std::fill(address.s6_addr + kNetworkBytes, std::end(address.s6_addr), 0);
  char text[INET6_ADDRSTRLEN];
  return absl::StrCat(inet_ntop(AF_INET6, &address, text, sizeof text), "/64");
}

// An IP address in one form; nothing if it is none.
std::optional<std::string> plain_address(absl::string_view text) {
  const std::string host(absl::StripAsciiWhitespace(text));
  in_addr four;
  if (host.size() > INET6_ADDRSTRLEN) return std::nullopt;
  if (inet_pton(AF_INET, host.c_str(), &four) == 1) return host;
  in6_addr six;
  if (inet_pton(AF_INET6, host.c_str(), &six) != 1) return std::nullopt;
  return network_of(six);
}

absl::string_view view_of(const grpc::string_ref& ref) { return {ref.data(), ref.size()}; }

// The last header of that name, because a proxy adds its own after those that the client sent.
absl::string_view last_header(const grpc::ServerContextBase& context, const char* name) {
  const auto [first, end] = context.client_metadata().equal_range(name);
  absl::string_view last;
  for (auto header = first; header != end; ++header) last = view_of(header->second);
  return last;
}

std::string hash_of(absl::string_view name) {
  return absl::BytesToHexString(sha256(std::string(name)).substr(0, kHashBytes));
}

}  // namespace

std::string client_address(absl::string_view peer, absl::string_view forwarded_for) {
  if (absl::ConsumePrefix(&peer, "ipv4:") || absl::ConsumePrefix(&peer, "ipv6:")) {
    const std::string host = absl::StrReplaceAll(peer.substr(0, peer.rfind(':')),
                                                 {{"%5B", ""}, {"%5D", ""}, {"[", ""}, {"]", ""}});
    return plain_address(host).value_or("unknown");
  }
  if (!absl::StartsWith(peer, "unix")) return "local";
  if (forwarded_for.size() > kMaxForwarded) {
    forwarded_for.remove_prefix(forwarded_for.size() - kMaxForwarded);
  }
  const size_t comma = forwarded_for.rfind(',');
  if (comma != absl::string_view::npos) forwarded_for.remove_prefix(comma + 1);
  return plain_address(forwarded_for).value_or("local");
}

std::string client_address(const grpc::ServerContextBase& context) {
  return client_address(context.peer(), last_header(context, "x-forwarded-for"));
}

bool is_straight_from_this_host(const grpc::ServerContextBase& context) {
  return absl::StartsWith(context.peer(), "unix") && last_header(context, "x-forwarded-for").empty();
}

std::string client_address(const sockaddr_storage& peer) {
  if (peer.ss_family == AF_INET) return text_of(reinterpret_cast<const sockaddr_in&>(peer).sin_addr);
  if (peer.ss_family == AF_INET6) return network_of(reinterpret_cast<const sockaddr_in6&>(peer).sin6_addr);
  return "local";
}

std::string client_of(int descriptor) {
  sockaddr_storage peer{};
  socklen_t size = sizeof peer;
  if (getpeername(descriptor, reinterpret_cast<sockaddr*>(&peer), &size) != 0) return "unknown";
  return client_address(peer);
}

std::string client_identity(const grpc::ServerContextBase& context, bool tokens) {
  std::string identity = client_address(context);
  if (tokens) absl::StrAppend(&identity, " token ", hash_of(last_header(context, "authorization")));
  const std::shared_ptr<const grpc::AuthContext> auth = context.auth_context();
  if (auth == nullptr || !auth->IsPeerAuthenticated()) return identity;
  std::string names;
  for (const grpc::string_ref& name : auth->GetPeerIdentity()) absl::StrAppend(&names, view_of(name), "\n");
  if (!names.empty()) absl::StrAppend(&identity, " certificate ", hash_of(names));
  return identity;
}

}  // namespace candela
