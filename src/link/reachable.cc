#include "link/reachable.h"

#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>

namespace palpate::link {
namespace {

namespace ip = boost::asio::ip;

// what only this machine or this cable knows
bool is_local(const ip::address& address) {
  constexpr std::uint32_t kLinkLocal = 0xa9fe0000, kLinkLocalMask = 0xffff0000;  // 169.254.0.0/16
  if (address.is_loopback()) return true;
  if (address.is_v6()) return address.to_v6().is_link_local();
  return (address.to_v4().to_uint() & kLinkLocalMask) == kLinkLocal;
}

}  // namespace

std::vector<ip::address> own_addresses() {
  std::vector<ip::address> own;
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return own;
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> list(first, ::freeifaddrs);
  for (const ifaddrs* entry = first; entry; entry = entry->ifa_next) {
    if (!entry->ifa_addr || (entry->ifa_flags & IFF_UP) == 0) continue;
    if (entry->ifa_addr->sa_family == AF_INET) {
      sockaddr_in v4;
      std::memcpy(&v4, entry->ifa_addr, sizeof v4);
      own.push_back(ip::make_address_v4(ntohl(v4.sin_addr.s_addr)));
    } else if (entry->ifa_addr->sa_family == AF_INET6) {
      sockaddr_in6 v6;
      std::memcpy(&v6, entry->ifa_addr, sizeof v6);
      ip::address_v6::bytes_type bytes;
      std::copy(std::begin(v6.sin6_addr.s6_addr), std::end(v6.sin6_addr.s6_addr), bytes.begin());
      own.push_back(ip::address_v6(bytes));
    }
  }
  return own;
}

ip::address reachable_address(const ip::address& listened, const std::vector<ip::address>& own,
                              bool v6_only) {
  if (!listened.is_unspecified()) return listened;
  const bool takes_v4 = listened.is_v4() || !v6_only, takes_v6 = listened.is_v6();
  // IPv4 first: people can type it
  for (const bool v4 : {true, false}) {
    if (!(v4 ? takes_v4 : takes_v6)) continue;
    const auto found = std::find_if(own.begin(), own.end(), [&](const ip::address& address) {
      return address.is_v4() == v4 && !is_local(address);
    });
    if (found != own.end()) return *found;
  }
  if (takes_v4) return ip::address_v4::loopback();
  return ip::address_v6::loopback();
}

}  // namespace palpate::link
