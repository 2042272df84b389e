#pragma once

#include <chrono>
#include <string_view>

#include "link/address.h"

namespace palpate::link {

/// The parts of a request that decide its answer. Header fields that are not there are empty.
struct HttpRequest {
  std::string_view method, target;
  std::string_view host, origin, fetch_site, authorization, accept_encoding, if_none_match;
  /// What two programs could read in two ways: host, origin, authorization or the length of a body twice, or
  /// a body in another form than its bytes.
  bool ambiguous = false;
  bool has_body = false;
  bool keep_alive = false;         ///< the viewer may send another request on this connection
  bool upgrade = false;            ///< to a WebSocket
  bool subprotocol = false;        ///< ours is among those that the viewer speaks
  std::string_view local_address;  ///< where the connection arrived
  AddressBlock from{};             ///< where it came from
  std::chrono::steady_clock::time_point at{};
};

}  // namespace palpate::link
