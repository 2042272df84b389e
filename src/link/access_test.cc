#include "link/access.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "base/test_folder.h"

namespace palpate::link {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_text;

constexpr const char* kControl = "abcdefghijklmnop";
constexpr const char* kView = "0123456789abcdefXYZ";

Tokens both() {
  return *Tokens::parse(std::string("# ours\ncontrol ") + kControl + "\r\n\nview " + kView + "\n", "tokens");
}

TEST(Tokens, GiveTheirRoles) {
  const Tokens tokens = both();
  EXPECT_EQ(tokens.role_of(kControl), Role::kControl);
  EXPECT_EQ(tokens.role_of(kView), Role::kView);
  for (const char* wrong :
       {"", "abcdefghijklmno", "abcdefghijklmnopq", "ABCDEFGHIJKLMNOP", "control abcdefghijklmnop"})
    EXPECT_FALSE(tokens.role_of(wrong)) << wrong;
}

TEST(Tokens, FaultyFilesNameTheirLineAndNoToken) {
  const auto line_of = [](const std::string& text) {
    const auto tokens = Tokens::parse(text, "tokens");
    EXPECT_FALSE(tokens.ok()) << text;
    if (tokens.ok()) return std::string();
    EXPECT_EQ(tokens.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(tokens.error().message().find("secret"), std::string::npos);
    return tokens.error().where;
  };
  EXPECT_EQ(line_of(""), "tokens");
  EXPECT_EQ(line_of("# nothing\n"), "tokens");
  EXPECT_EQ(line_of("control secretsecret1234\nview short-secret\n"), "tokens:2");
  EXPECT_EQ(line_of("control secretsecret 123\n"), "tokens:1");
  EXPECT_EQ(line_of("secretsecretsecret\n"), "tokens:1");
  EXPECT_EQ(line_of("admin secretsecretsecret\n"), "tokens:1");
  EXPECT_EQ(line_of("control secretsecr\xc3\xa4secret\n"), "tokens:1");
  EXPECT_EQ(line_of("control\n"), "tokens:1");
}

TEST(Tokens, AFileThatOthersMayReadIsWarnedOf) {
  const TemporaryFolder folder;
  const auto file = write_text(folder / "tokens", std::string("view ") + kView + "\n");
  std::string warned;
  const auto warn = [&](const std::string& line) { warned += line; };
  ::chmod(file.c_str(), 0600);
  ASSERT_TRUE(Tokens::read(file, warn).ok());
  EXPECT_EQ(warned, "");
  ::chmod(file.c_str(), 0640);
  ASSERT_TRUE(Tokens::read(file, warn).ok());
  EXPECT_NE(warned.find("chmod 600"), std::string::npos);
  EXPECT_EQ(warned.find(kView), std::string::npos);
  EXPECT_FALSE(Tokens::read(folder / "none", warn).ok());
}

TEST(Access, ServesItsOwnNamesAlone) {
  const Access access("127.0.0.1", 8480, false, {"theatre.example", "tunnel:9000"}, {});
  for (const char* host : {"localhost:8480", "LOCALHOST:8480", "127.0.0.1:8480", "[::1]:8480",
                           "theatre.example:8480", "tunnel:9000", "192.168.1.5:8480"})
    EXPECT_TRUE(access.serves(host, "192.168.1.5")) << host;
  for (const char* host :
       {"", "localhost", "127.0.0.1", "localhost:8481", "localhost:84800", "localhost:08480", "evil.example",
        "evil.example:8480", "localhost.evil.example:8480", "xlocalhost:8480", "127.0.0.2:8480", "::1:8480",
        "tunnel:8480", "tunnel", "192.168.1.6:8480", "localhost:8480:8480", "localhost:8480 "})
    EXPECT_FALSE(access.serves(host, "192.168.1.5")) << host;
}

TEST(Access, TheDefaultPortMayBeLeftOut) {
  EXPECT_TRUE(Access("127.0.0.1", 80, false, {}, {}).serves("localhost", "127.0.0.1"));
  EXPECT_TRUE(Access("127.0.0.1", 443, true, {}, {}).serves("[::1]", "127.0.0.1"));
  EXPECT_FALSE(Access("127.0.0.1", 443, false, {}, {}).serves("localhost", "127.0.0.1"));
  EXPECT_TRUE(Access("2001:db8::1", 8480, false, {}, {}).serves("[2001:db8::1]:8480", "2001:db8::1"));
}

TEST(Access, OnlyItsOwnPageIsItsOwnOrigin) {
  const Access access("127.0.0.1", 8480, false, {}, {});
  EXPECT_TRUE(access.is_own_origin("", "localhost:8480"));
  EXPECT_TRUE(access.is_own_origin("http://localhost:8480", "localhost:8480"));
  for (const char* origin :
       {"null", "http://", "http://localhost", "https://localhost:8480", "http://127.0.0.1:8480",
        "http://evil.example", "http://localhost:8480.evil.example", "localhost:8480",
        "http://localhost:8480/"})
    EXPECT_FALSE(access.is_own_origin(origin, "localhost:8480")) << origin;
  EXPECT_TRUE(
      Access("127.0.0.1", 8480, true, {}, {}).is_own_origin("https://localhost:8480", "localhost:8480"));
}

TEST(Access, WithoutTokensEverybodyHasControl) {
  EXPECT_EQ(Access("127.0.0.1", 8480, false, {}, {}).role_of(""), Role::kControl);
  const Access guarded("127.0.0.1", 8480, false, {}, both());
  EXPECT_FALSE(guarded.role_of(""));
  EXPECT_EQ(guarded.role_of(Access::bearer(std::string("Bearer ") + kView)), Role::kView);
  EXPECT_EQ(Access::bearer("bearer x"), "x");
  for (const char* other : {"", "Bearer", "Basic eA==", "x"}) EXPECT_EQ(Access::bearer(other), "") << other;
}

}  // namespace
}  // namespace palpate::link
