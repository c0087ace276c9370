// A client's TLS and token options.
#pragma once

#include <string>

namespace candela {

// Default: a plain connection without a token. Certificates and keys are PEM files; they are read when a
// connection or session is opened. A "unix:PATH" address never uses TLS, but sends the token.
struct ClientSecurity {
  bool tls = false;              // use TLS; setting ca_file, cert_file or server_name implies it
  std::string ca_file = {};      // CAs to trust; empty: the system's
  std::string cert_file = {};    // certificate for servers that ask for one; needs key_file
  std::string key_file = {};     // private key of cert_file
  std::string server_name = {};  // name in the server's certificate, if it is not the address's host
  // A file whose first line that is neither empty nor begins with # is a bearer token. It is read again for
  // each call, so it may be replaced at any time; if it cannot be read, the previous token is sent. The token
  // is never sent over plain TCP except to loopback.
  std::string token_file = {};

  bool wants_tls() const { return tls || !ca_file.empty() || !cert_file.empty() || !server_name.empty(); }
};

// A server and how to connect to it.
struct Peer {
  std::string address;  // "HOST:PORT" or "unix:PATH"; "this process" for a server in this process
  ClientSecurity security = {};
};

}  // namespace candela
