#include "server/reachable.h"

#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace palpate::server {
namespace {

// addresses valid on this machine or link only
bool is_local(const IpAddress& address) {
  return address.is_loopback() || address.is_link_local();
}

}  // namespace

std::vector<IpAddress> own_addresses() {
  std::vector<IpAddress> own;
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return own;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> list(first, ::freeifaddrs);
  for (const ifaddrs* entry = first; entry; entry = entry->ifa_next) {
    if (!entry->ifa_addr || (entry->ifa_flags & IFF_UP) == 0) continue;
    if (entry->ifa_addr->sa_family == AF_INET) {
      sockaddr_in v4;
      std::memcpy(&v4, entry->ifa_addr, sizeof v4);
      IpAddress::V4Bytes bytes;
      std::memcpy(bytes.data(), &v4.sin_addr, bytes.size());
      own.emplace_back(bytes);
    } else if (entry->ifa_addr->sa_family == AF_INET6) {
      sockaddr_in6 v6;
      std::memcpy(&v6, entry->ifa_addr, sizeof v6);
      IpAddress::V6Bytes bytes;
      std::copy(std::begin(v6.sin6_addr.s6_addr), std::end(v6.sin6_addr.s6_addr), bytes.begin());
      own.emplace_back(bytes);
    }
  }
  return own;
}

IpAddress reachable_address(const IpAddress& listened, const std::vector<IpAddress>& own, bool v6_only) {
  if (!listened.is_unspecified()) return listened;
  const bool takes_v4 = !listened.is_v6() || !v6_only, takes_v6 = listened.is_v6();
  // IPv4 first, since it is easier to type
  for (const bool v4 : {true, false}) {
    if (!(v4 ? takes_v4 : takes_v6)) continue;
    const auto found = std::find_if(own.begin(), own.end(), [&](const IpAddress& address) {
      return address.is_v6() != v4 && !is_local(address);
    });
    if (found != own.end()) return *found;
  }
  return takes_v4 ? IpAddress::loopback_v4() : IpAddress::loopback_v6();
}

}  // namespace palpate::server
