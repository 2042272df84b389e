#include "server/access.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <map>
#include <set>
#include <sstream>

#include "base/test_folder.h"
#include "palpate/base/file.h"
#include "palpate/server/viewer_tokens.h"

namespace palpate::server {
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
  EXPECT_EQ(tokens.holder_of(kControl)->role, Role::kControl);
  EXPECT_EQ(tokens.holder_of(kView)->role, Role::kView);
  for (const char* wrong :
       {"", "abcdefghijklmno", "abcdefghijklmnopq", "ABCDEFGHIJKLMNOP", "control abcdefghijklmnop"})
    EXPECT_FALSE(tokens.holder_of(wrong)) << wrong;
}

TEST(Tokens, SayWhichLearnerComes) {
  const auto tokens = Tokens::parse(
      "learner k7wq2mzr9xbt4hvc L042\nteacher t4hvck7wq2mzr9xb\nlearner 9xbt4hvck7wq2mzr Lernende 7\n"
      "learner mzr9xbt4hvck7wq2 L042\n",
      "tokens");
  ASSERT_TRUE(tokens.ok()) << tokens.error().message();
  EXPECT_EQ(tokens->holder_of("k7wq2mzr9xbt4hvc")->learner, "L042");
  EXPECT_EQ(tokens->holder_of("9xbt4hvck7wq2mzr")->learner, "Lernende 7");
  EXPECT_EQ(tokens->holder_of("9xbt4hvck7wq2mzr")->role, Role::kLearner);
  EXPECT_EQ(tokens->holder_of("t4hvck7wq2mzr9xb")->role, Role::kTeacher);
  EXPECT_EQ(tokens->holder_of("t4hvck7wq2mzr9xb")->learner, "");
  EXPECT_EQ(tokens->learners(), (std::vector<std::string>{"L042", "Lernende 7"}));
  EXPECT_TRUE(tokens->has(Role::kTeacher));
  EXPECT_FALSE(tokens->has(Role::kControl));
}

TEST(Tokens, CreatesTokensOfARole) {
  const auto line = new_viewer_tokens({"learner", "L042"});
  ASSERT_TRUE(line.ok());
  EXPECT_EQ(Tokens::parse(*line, "new")->learners(), std::vector<std::string>{"L042"});
  EXPECT_TRUE(Tokens::parse(*new_viewer_tokens({"teacher", ""}), "new")->has(Role::kTeacher));
  EXPECT_EQ(new_viewer_tokens({"learner", ""}).error().kind, ErrorKind::kUsage);
  EXPECT_EQ(new_viewer_tokens({"teacher", "L042"}).error().kind, ErrorKind::kUsage);
  EXPECT_EQ(new_viewer_tokens({"learner", "two\nlines"}).error().kind, ErrorKind::kBadInput);
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
  EXPECT_EQ(line_of("learner secretsecret1234\n"), "tokens:1");
  EXPECT_EQ(line_of("learner secretsecret1234 " + std::string(65, 'x') + "\n"), "tokens:1");
  EXPECT_EQ(line_of("learner secretsecret1234 L\x1b[2J\n"), "tokens:1");
  EXPECT_EQ(line_of("teacher secretsecret1234 L042\n"), "tokens:1");
  // a duplicate token would identify two people
  EXPECT_EQ(line_of("view secretsecret1234\n\nlearner secretsecret1234 L042\n"), "tokens:3");
}

TEST(Tokens, WeakOnesAreRefusedOrWarnedOf) {
  const auto refused = [](const std::string& token) {
    const auto tokens = Tokens::parse("# ours\nview " + token, "tokens");
    if (tokens.ok()) return false;
    EXPECT_EQ(tokens.error().where, "tokens:2");
    EXPECT_NE(tokens.error().remedy.find("palpate token"), std::string::npos);
    EXPECT_EQ(tokens.error().message().find(token), std::string::npos);
    return true;
  };
  for (const char* token : {"short-one", "aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
                            "abababababababababababab", "xyzxyzxyzxyzxyzxyz", "12345678901234567890"})
    EXPECT_TRUE(refused(token)) << token;
  const auto warned = [](const std::string& token) {
    std::string lines;
    EXPECT_TRUE(
        Tokens::parse("control " + token, "tokens", [&](const std::string& line) { lines += line; }).ok());
    EXPECT_EQ(lines.find(token), std::string::npos);
    EXPECT_TRUE(lines.empty() || lines.find("tokens:1: ") == 0) << lines;
    return !lines.empty();
  };
  for (const char* token :
       {"abcdefghijklmnop", "0123456789abcdef", "operating-operating-", "7391846205738164"})
    EXPECT_TRUE(warned(token)) << token;
  for (const char* token : {"k7wq2mzr9xbt4hvc", "9f86d081884c7d659a2feaa0c55ad015"})
    EXPECT_FALSE(warned(token)) << token;
}

TEST(Tokens, NewOnesAreRandom) {
  std::set<std::string> visited;
  std::map<char, int> characters;
  for (int n = 0; n < 500; ++n) {
    const auto text = new_viewer_tokens();
    ASSERT_TRUE(text.ok());
    std::string warned;
    const auto tokens = Tokens::parse(*text, "new", [&](const std::string& line) { warned += line; });
    ASSERT_TRUE(tokens.ok()) << *text;
    EXPECT_EQ(warned, "");
    std::istringstream lines(*text);
    std::string role, token;
    for (const char* expected : {"control", "view"}) {
      lines >> role >> token;
      EXPECT_EQ(role, expected);
      EXPECT_GE(entropy_bound_bits(token), 80) << token;
      EXPECT_EQ(token.size(), 26u);
      EXPECT_TRUE(visited.insert(token).second) << token;
      for (const char c : token) ++characters[c];
    }
    EXPECT_EQ(tokens->holder_of(token)->role, Role::kView);
  }
  // 26 characters out of 32 equally likely ones are 130 bits; 812 expected of each, standard deviation 28
  ASSERT_EQ(characters.size(), 32u);
  for (const auto& [c, count] : characters) EXPECT_NEAR(count, 812.5, 6 * 28) << c;
}

TEST(Tokens, AFileOfNewOnesIsItsOwnersAlone) {
  const TemporaryFolder folder;
  const auto file = folder / "tokens";
  const mode_t before = ::umask(0);
  ASSERT_TRUE(write_viewer_tokens(file, *new_viewer_tokens()).ok());
  ::umask(before);
  struct stat status;
  ASSERT_EQ(::stat(file.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777, 0600u);
  std::string warned;
  EXPECT_TRUE(Tokens::read(file, [&](const std::string& line) { warned += line; }).ok());
  EXPECT_EQ(warned, "");
  // an existing file is never overwritten, because its holders would be locked out
  const std::string tokens = *read_file(file);
  const auto again = write_viewer_tokens(file, *new_viewer_tokens());
  ASSERT_FALSE(again.ok());
  EXPECT_EQ(again.error().kind, ErrorKind::kOutput);
  EXPECT_EQ(*read_file(file), tokens);
  EXPECT_EQ(write_viewer_tokens(folder / "none" / "tokens", "view").error().kind, ErrorKind::kOutput);
}

TEST(Tokens, RefusesWorldReadableFilesAndWarnsOfGroupReadable) {
  const TemporaryFolder folder;
  constexpr const char* kStrong = "k7wq2mzr9xbt4hvc";
  const auto file = write_text(folder / "tokens", std::string("view ") + kStrong + "\n");
  std::string warned;
  const auto warn = [&](const std::string& line) { warned += line; };
  ::chmod(file.c_str(), 0600);
  ASSERT_TRUE(Tokens::read(file, warn).ok());
  EXPECT_EQ(warned, "");
  ::chmod(file.c_str(), 0640);
  ASSERT_TRUE(Tokens::read(file, warn).ok());
  EXPECT_NE(warned.find("chmod 600"), std::string::npos);
  EXPECT_EQ(warned.find(kStrong), std::string::npos);
  for (const mode_t mode : {0644u, 0604u, 0602u, 0601u}) {
    ::chmod(file.c_str(), mode);
    const auto open_to_all = Tokens::read(file, {});
    ASSERT_FALSE(open_to_all.ok()) << mode;
    EXPECT_EQ(open_to_all.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(open_to_all.error().where, file.string());
    EXPECT_NE(open_to_all.error().remedy.find("chmod 600"), std::string::npos);
    EXPECT_FALSE(holders_of_tokens(file).ok()) << mode;
  }
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

TEST(Access, WithoutTokensEveryViewerHasControl) {
  EXPECT_EQ(Access("127.0.0.1", 8480, false, {}, {}).admit("", {}, {}).who->role, Role::kControl);
  Access guarded("127.0.0.1", 8480, false, {}, both());
  EXPECT_FALSE(guarded.admit("", {}, {}).who);
  EXPECT_EQ(guarded.admit(Access::bearer(std::string("Bearer ") + kView), {}, {}).who->role, Role::kView);
  EXPECT_EQ(Access::bearer("bearer x"), "x");
  for (const char* other : {"", "Bearer", "Basic eA==", "x"}) EXPECT_EQ(Access::bearer(other), "") << other;
}

}  // namespace
}  // namespace palpate::server
