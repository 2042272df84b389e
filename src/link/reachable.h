#pragma once

#include <vector>

#include "link/address.h"

/// Addresses that a browser can open.
namespace palpate::link {

/// Those of this machine's networks that are up; none where that cannot be found out.
std::vector<IpAddress> own_addresses();

/// The address by which to tell others of a server: the one that it listens at, or, where that is all of them
/// (0.0.0.0, ::), the first that other machines may know, else the loopback one.
/// @param own      the machine's addresses
/// @param v6_only  whether a server at :: takes no IPv4
IpAddress reachable_address(const IpAddress& listened, const std::vector<IpAddress>& own, bool v6_only);

}  // namespace palpate::link
