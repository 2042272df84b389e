#pragma once

#include <chrono>
#include <string_view>

#include "palpate/server/address.h"

namespace palpate::server {

/// Parts of a request that determine its answer. Missing header fields are empty.
struct HttpRequest {
  std::string_view method, target;
  std::string_view host, origin, fetch_site, authorization, accept_encoding, if_none_match;
  /// Whether two programs could parse the request differently: duplicate host, origin, authorization or
  /// content length, or a body with a transfer encoding.
  bool ambiguous = false;
  bool has_body = false;
  bool keep_alive = false;         ///< Whether the viewer may send another request on this connection
  bool upgrade = false;            ///< Whether an upgrade to a WebSocket is requested
  bool subprotocol = false;        ///< Whether our subprotocol is among those offered
  std::string_view local_address;  ///< Local address of the connection
  AddressBlock from{};             ///< Address block of the peer
  std::chrono::steady_clock::time_point at{};
};

}  // namespace palpate::server
