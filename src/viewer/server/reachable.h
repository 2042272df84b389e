#pragma once

#include <vector>

#include "palpate/server/address.h"

/// Addresses at which a browser can reach the server.
namespace palpate::server {

/// Addresses of this machine's active interfaces; empty if they cannot be determined.
std::vector<IpAddress> own_addresses();

/// Address to publish for a server: its listening address or, if that is unspecified (0.0.0.0, ::), the first
/// non-local address of the machine, else loopback.
/// @param own      addresses of the machine
/// @param v6_only  whether a server at :: does not accept IPv4
IpAddress reachable_address(const IpAddress& listened, const std::vector<IpAddress>& own, bool v6_only);

}  // namespace palpate::server
