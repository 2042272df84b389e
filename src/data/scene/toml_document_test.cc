#include "scene/toml_document.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate {
namespace {

using testing::HasSubstr;

constexpr std::size_t kMiB = std::size_t{1} << 20;

std::string repeat(const std::string& text, std::size_t times) {
  std::string all;
  all.reserve(text.size() * times);
  for (std::size_t i = 0; i < times; ++i) all += text;
  return all;
}

TEST(TomlDocument, KeepsValuesAndTheirLines) {
  const auto table = parse_toml("a = 1\n\n[b]\nc = [\n  true,\n  'x', 2.5]\n[[d]]\n[[d]]\n", kMiB, "t");
  ASSERT_TRUE(table.ok());
  EXPECT_EQ(*table->find("a")->as<std::int64_t>(), 1);
  EXPECT_EQ(table->find("a")->line, 1);
  const auto* b = table->find("b")->as<TomlTable>();
  ASSERT_NE(b, nullptr);
  EXPECT_EQ(b->line, 3);
  const auto& c = *b->find("c")->as<TomlArray>();
  EXPECT_EQ(b->find("c")->line, 4);
  ASSERT_EQ(c.size(), 3u);
  EXPECT_TRUE(*c[0].as<bool>());
  EXPECT_EQ(c[0].line, 5);
  EXPECT_EQ(*c[1].as<std::string>(), "x");
  EXPECT_EQ(*c[2].as<double>(), 2.5);
  EXPECT_EQ(c[2].line, 6);
  const auto& d = *table->find("d")->as<TomlArray>();
  ASSERT_EQ(d.size(), 2u);
  EXPECT_EQ(d[0].as<TomlTable>()->line, 7);
  EXPECT_EQ(d[1].as<TomlTable>()->line, 8);
  EXPECT_EQ(table->find("e"), nullptr);
}

TEST(TomlDocument, NamesTheLineOfASyntaxError) {
  const auto table = parse_toml("a = 1\nb = = 2\n", kMiB, "t.toml");
  ASSERT_FALSE(table.ok());
  EXPECT_EQ(table.error().where, "t.toml:2");
  EXPECT_EQ(table.error().kind, ErrorKind::kBadInput);
}

TEST(TomlDocument, RefusesTextsThatAreTooLong) {
  EXPECT_TRUE(parse_toml(std::string(100, '\n'), 100, "t").ok());
  EXPECT_FALSE(parse_toml(std::string(101, '\n'), 100, "t").ok());
}

// found by fuzzing: an assertion of the library preceded its own error message
TEST(TomlDocument, RefusesHeadersThatNameNothing) {
  for (const char* text : {"[%step]]", "[[st\x9b", "[[%]]", "[ = ]", "[#]", "[[\n", "[.a]", "[a.]", "[a.%]"})
    EXPECT_FALSE(parse_toml(text, kMiB, "t").ok()) << text;
}

// found by fuzzing: letters missing from the library's whitespace tables
TEST(TomlDocument, LettersBeyondAsciiAreNoWhitespace) {
  for (const char* letter : {"\xc3\xa9", "\xef\xbb\xbe", "\xef\xac\xa6", "\xe2\x81\xa1"}) {
    EXPECT_FALSE(parse_toml(std::string(letter) + " = 1", kMiB, "t").ok());
    EXPECT_FALSE(parse_toml(std::string("t") + letter + "e e=#", kMiB, "t").ok());
    EXPECT_FALSE(parse_toml(std::string("a = \"\"\"\\") + letter + "\"\"\"", kMiB, "t").ok());
    const auto table = parse_toml(std::string("a = \"\"\"\\\n  ") + letter + "\"\"\"", kMiB, "t");
    ASSERT_TRUE(table.ok()) << table.error().message();
    EXPECT_EQ(*table->find("a")->as<std::string>(), letter);
  }
}

// each text nests as deeply as its size allows; without the guards some overflow the stack
TEST(TomlDocument, SurvivesHostileNesting) {
  for (const std::string& unit :
       {std::string("["), std::string("{a="), std::string("[{a="), std::string("a."), std::string("\"a\"."),
        std::string("'' . "), std::string("{a.b.c.d.e.f.g.h="), std::string("[[a]]\n[a."),
        std::string("\"\"\"")}) {
    const std::string deep = repeat(unit, 4 * kMiB / unit.size());
    for (const std::string& text : {deep, "a = " + deep, "[" + deep, "a = [" + deep, deep + "a = 1"})
      EXPECT_FALSE(parse_toml(text, 5 * kMiB, "t").ok()) << unit;
  }
}

// the deepest text that both guards accept is read and freed
TEST(TomlDocument, ReadsTheMaximumNesting) {
  const std::string key = "a.b.c.d.e.f.g.h";
  std::string text = key + " = 1";
  for (int i = 0; i < 30; ++i) text = key + " = {" + text + "}";
  EXPECT_TRUE(parse_toml("[" + key + "]\n" + text, kMiB, "t").ok());
  EXPECT_FALSE(parse_toml(key + ".i = 1", kMiB, "t").ok());
}

TEST(TomlDocument, DotsInTextsCommentsAndNumbersAreNoKeys) {
  const std::string dots = repeat(".", 200);
  const std::string text = "a = \"" + dots + "\\\"" + dots + "\" # " + dots + "\nb = '" + dots +
                           "'\nc = \"\"\"" + dots + "\n\"" + dots + "\"\"\"\nd = '''" + dots + "''" + dots +
                           "'''\ne = [1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5, 10.5, 11.5]\n";
  const auto table = parse_toml(text, kMiB, "t");
  ASSERT_TRUE(table.ok()) << table.error().message();
  EXPECT_EQ(table->find("c")->as<std::string>()->size(), 402u);
}

TEST(TomlDocument, NamesTheLineOfAKeyThatIsTooLong) {
  const auto table = parse_toml("x = 'a'\n\n" + repeat("a.", 100) + "b = 1\n", kMiB, "t");
  ASSERT_FALSE(table.ok());
  EXPECT_EQ(table.error().where, "t:3");
  EXPECT_THAT(table.error().what, HasSubstr("joined by dots"));
}

}  // namespace
}  // namespace palpate
