// How a client makes sure whom it talks to, and shows who it is.
#pragma once

#include <string>

namespace candela {

// Files are PEM but for the token's. Over "unix:PATH" there is no TLS, whatever stands here, and the token is
// sent.
struct ClientSecurity {
  bool tls = false;              // TLS; so do ca_file, cert_file and server_name
  std::string ca_file = {};      // whom to trust; empty: the CAs of the system
  std::string cert_file = {};    // a certificate to show to servers that ask for one, and its key
  std::string key_file = {};     // read, as the two above, when a connection or a session is opened
  std::string server_name = {};  // in the server's certificate, where that is not the address's host
  // The first line that is neither empty nor begins with # is a bearer token. Read anew for each call, so
  // that it may be replaced; while it cannot be read the last one is sent. It is never sent over plain TCP
  // beyond loopback.
  std::string token_file = {};

  bool wants_tls() const { return tls || !ca_file.empty() || !cert_file.empty() || !server_name.empty(); }
};

// A server.
struct Peer {
  std::string address;  // "HOST:PORT" or "unix:PATH"; other words for one in this process
  ClientSecurity security = {};
};

}  // namespace candela
