#include "palpate/server/address.h"

#include <arpa/inet.h>
#include <net/if.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstdlib>
#include <iterator>

namespace palpate::server {
namespace {

constexpr IpAddress::V6Bytes kLoopbackV6{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1};
constexpr std::array<unsigned char, 12> kMappedPrefix{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
// a /64 network
constexpr std::size_t kBlockBytes = 8;

std::uint32_t scope_of(const std::string& name) {
  const unsigned number = ::if_nametoindex(name.c_str());
  return number != 0 ? number : static_cast<std::uint32_t>(std::strtoul(name.c_str(), nullptr, 10));
}

}  // namespace

IpAddress::IpAddress(const V4Bytes& bytes) : is_v6_(false) {
  std::copy(bytes.begin(), bytes.end(), bytes_.begin());
}

IpAddress::IpAddress(const V6Bytes& bytes, std::uint32_t scope_id)
    : is_v6_(true), bytes_(bytes), scope_id_(scope_id) {}

std::optional<IpAddress> IpAddress::parse(const std::string& text) {
  // a system call would read up to the first zero byte
  if (text.find('\0') != std::string::npos) return std::nullopt;
  V4Bytes v4{};
  if (::inet_pton(AF_INET, text.c_str(), v4.data()) == 1) return IpAddress(v4);
  const std::size_t percent = text.find('%');
  V6Bytes v6{};
  if (::inet_pton(AF_INET6, text.substr(0, percent).c_str(), v6.data()) != 1) return std::nullopt;
  return IpAddress(v6, percent == std::string::npos ? 0 : scope_of(text.substr(percent + 1)));
}

IpAddress IpAddress::loopback_v4() {
  return IpAddress(V4Bytes{127, 0, 0, 1});
}

IpAddress IpAddress::loopback_v6() {
  return IpAddress(kLoopbackV6);
}

bool IpAddress::is_loopback() const {
  return is_v6_ ? bytes_ == kLoopbackV6 : bytes_[0] == 127;
}

bool IpAddress::is_unspecified() const {
  return bytes_ == V6Bytes{};
}

bool IpAddress::is_link_local() const {
  return is_v6_ ? bytes_[0] == 0xfe && (bytes_[1] & 0xc0) == 0x80 : bytes_[0] == 169 && bytes_[1] == 254;
}

IpAddress IpAddress::unmapped() const {
  if (!is_v6_ || !std::equal(kMappedPrefix.begin(), kMappedPrefix.end(), bytes_.begin())) return *this;
  V4Bytes v4{};
  std::copy(bytes_.begin() + kMappedPrefix.size(), bytes_.end(), v4.begin());
  return IpAddress(v4);
}

IpAddress IpAddress::without_scope() const {
  IpAddress address = *this;
  address.scope_id_ = 0;
  return address;
}

std::string IpAddress::text() const {
  std::array<char, INET6_ADDRSTRLEN> buffer{};
  ::inet_ntop(is_v6_ ? AF_INET6 : AF_INET, bytes_.data(), buffer.data(), buffer.size());
  std::string text = buffer.data();
  if (scope_id_ == 0) return text;
  std::array<char, IF_NAMESIZE> name{};
  const bool is_named = is_link_local() && ::if_indextoname(scope_id_, name.data()) != nullptr;
  return text + "%" + (is_named ? name.data() : std::to_string(scope_id_));
}

AddressBlock block_of(const IpAddress& address) {
  const IpAddress unmapped = address.unmapped();
  AddressBlock block{};
  if (unmapped.is_v6()) {
    std::copy_n(unmapped.bytes().begin(), kBlockBytes, block.begin());
    return block;
  }
  // marked by a byte that is zero in every IPv6 /64
  const std::size_t v4_bytes = std::tuple_size_v<IpAddress::V4Bytes>;
  std::copy_n(unmapped.bytes().begin(), v4_bytes, block.end() - v4_bytes);
  block[kBlockBytes] = 1;
  return block;
}

}  // namespace palpate::server
