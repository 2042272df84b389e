#include "server/reachable.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

namespace palpate::server {
namespace {

std::string reported(const char* listened, const std::vector<const char*>& own, bool v6_only = false) {
  std::vector<IpAddress> addresses;
  for (const char* text : own) addresses.push_back(IpAddress::parse(text).value());
  return reachable_address(IpAddress::parse(listened).value(), addresses, v6_only).text();
}

TEST(Reachable, AnAddressThatCanBeOpened) {
  // a specific listening address
  EXPECT_EQ(reported("127.0.0.1", {"127.0.0.1", "192.0.2.7"}), "127.0.0.1");
  EXPECT_EQ(reported("192.0.2.9", {"192.0.2.7"}), "192.0.2.9");
  // all addresses
  const std::vector<const char*> own{"127.0.0.1", "::1",         "fe80::1",   "169.254.3.4",
                                     "192.0.2.7", "2001:db8::7", "192.0.2.8", "2001:db8::8"};
  EXPECT_EQ(reported("0.0.0.0", own), "192.0.2.7");
  EXPECT_EQ(reported("::", own), "192.0.2.7");
  EXPECT_EQ(reported("::", own, true), "2001:db8::7");
  EXPECT_EQ(reported("::", {"::1", "2001:db8::7"}), "2001:db8::7");
  // no external network
  EXPECT_EQ(reported("0.0.0.0", {"127.0.0.1", "::1", "2001:db8::7"}), "127.0.0.1");
  EXPECT_EQ(reported("::", {}), "127.0.0.1");
  EXPECT_EQ(reported("::", {"::1"}, true), "::1");
}

TEST(Reachable, TheMachineKnowsItsLoopback) {
  const auto own = own_addresses();
  EXPECT_TRUE(std::any_of(own.begin(), own.end(), [](const auto& one) { return one.is_loopback(); }));
}

}  // namespace
}  // namespace palpate::server
