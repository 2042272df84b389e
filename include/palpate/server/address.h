#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

namespace palpate::server {

/// IPv4 or IPv6 address in network byte order.
class IpAddress {
 public:
  using V4Bytes = std::array<unsigned char, 4>;
  using V6Bytes = std::array<unsigned char, 16>;

  explicit IpAddress(const V4Bytes& bytes);
  /// @param scope_id  interface of a link-local address; 0: none
  explicit IpAddress(const V6Bytes& bytes, std::uint32_t scope_id = 0);
  /// Empty if the text is not a numeric address. An IPv6 scope may follow as %NAME or %NUMBER.
  static std::optional<IpAddress> parse(const std::string& text);
  /// 127.0.0.1
  static IpAddress loopback_v4();
  /// ::1
  static IpAddress loopback_v6();

  bool is_v6() const { return is_v6_; }
  bool is_loopback() const;
  /// 0.0.0.0 or ::
  bool is_unspecified() const;
  /// 169.254.0.0/16 or fe80::/10
  bool is_link_local() const;
  /// The IPv4 address in ::ffff:a.b.c.d; any other address unchanged.
  IpAddress unmapped() const;
  IpAddress without_scope() const;
  /// IPv4: in the first four bytes; the others are 0.
  const V6Bytes& bytes() const { return bytes_; }
  std::uint32_t scope_id() const { return scope_id_; }
  /// Numeric form, including the scope of an IPv6 address.
  std::string text() const;

 private:
  bool is_v6_;
  V6Bytes bytes_{};
  std::uint32_t scope_id_ = 0;
};

/// Address range that a single machine can use, for counting attempts: an IPv4 address, or a /64 of IPv6.
using AddressBlock = std::array<unsigned char, 16>;
AddressBlock block_of(const IpAddress& address);

}  // namespace palpate::server
