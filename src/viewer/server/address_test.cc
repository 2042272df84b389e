#include "palpate/server/address.h"

#include <gtest/gtest.h>

namespace palpate::server {
namespace {

IpAddress ip_address(const char* text) {
  return IpAddress::parse(text).value();
}

TEST(Address, RoundTrips) {
  for (const char* text :
       {"0.0.0.0", "127.0.0.1", "192.0.2.7", "::", "::1", "2001:db8::7", "::ffff:192.0.2.7", "2001:db8::7%3"})
    EXPECT_EQ(ip_address(text).text(), text);
  EXPECT_EQ(ip_address("2001:DB8:0::7").text(), "2001:db8::7");
  for (const char* text :
       {"", "localhost", "1.2.3", "1.2.3.4.5", "256.0.0.1", "01.2.3.4x", "[::1]", ":::", "1.2.3.4%1"})
    EXPECT_FALSE(IpAddress::parse(text)) << text;
  EXPECT_FALSE(IpAddress::parse(std::string("127.0.0.1\0x", 11)));
}

TEST(Address, Kinds) {
  EXPECT_TRUE(ip_address("127.9.9.9").is_loopback() && ip_address("::1").is_loopback());
  EXPECT_FALSE(ip_address("128.0.0.1").is_loopback() || ip_address("::2").is_loopback() ||
               ip_address("::ffff:127.0.0.1").is_loopback());
  EXPECT_TRUE(ip_address("0.0.0.0").is_unspecified() && ip_address("::").is_unspecified());
  EXPECT_FALSE(ip_address("0.0.0.1").is_unspecified() || ip_address("::1").is_unspecified());
  EXPECT_TRUE(ip_address("169.254.1.1").is_link_local() && ip_address("fe80::1").is_link_local() &&
              ip_address("febf::1").is_link_local());
  EXPECT_FALSE(ip_address("169.255.1.1").is_link_local() || ip_address("fec0::1").is_link_local());
}

// form in which a viewer writes it in Host
TEST(Address, WithoutMappingAndScope) {
  EXPECT_EQ(ip_address("::ffff:192.0.2.7").unmapped().text(), "192.0.2.7");
  EXPECT_EQ(ip_address("::fffe:192.0.2.7").unmapped().text(), ip_address("::fffe:192.0.2.7").text());
  EXPECT_EQ(ip_address("192.0.2.7").unmapped().text(), "192.0.2.7");
  EXPECT_EQ(ip_address("2001:db8::7%3").without_scope().text(), "2001:db8::7");
}

}  // namespace
}  // namespace palpate::server
