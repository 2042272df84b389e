#include "palpate/base/printable.h"

#include <gtest/gtest.h>

#include <random>

#include "base/test_seed.h"

namespace palpate {
namespace {

TEST(Printable, PrintableTextIsUnchanged) {
  for (const std::string text :
       {"femur, 5 mm", "os fémur", "大腿骨", "ترقوة", "\U0001F9B4", "a\n\tb", "~", " ", "\u00a0", ""})
    EXPECT_EQ(printable(text), text);
}

TEST(Printable, ControlCharactersAreEscapedAsInJson) {
  EXPECT_EQ(printable(std::string_view("\0\a\b\r\x1b[2J\x7f", 9)),
            "\\u0000\\u0007\\u0008\\u000d\\u001b[2J\\u007f");
  EXPECT_EQ(printable("\u0080\u009b\u009f"), "\\u0080\\u009b\\u009f") << "C1, in UTF-8";
  EXPECT_EQ(printable("\u061c\u200e\u200f\u2028\u202a\u202e\u2066\u2069\ufeff"),
            "\\u061c\\u200e\\u200f\\u2028\\u202a\\u202e\\u2066\\u2069\\ufeff");
  EXPECT_EQ(printable("\U000E0041"), "\\udb40\\udc41") << "a tag";
}

TEST(Printable, InvalidUtf8IsEscapedByteByByte) {
  EXPECT_EQ(printable("\x9b"
                      "31m"),
            "\\x9b31m");
  EXPECT_EQ(printable("caf\xe9"), "caf\\xe9");
  EXPECT_EQ(printable("\xc0\x9b\xe0\x80\x9b"), "\\xc0\\x9b\\xe0\\x80\\x9b") << "too long";
  EXPECT_EQ(printable("\xed\xa0\x80"), "\\xed\\xa0\\x80") << "half of a pair";
  EXPECT_EQ(printable("\xf4\x90\x80\x80\xff"), "\\xf4\\x90\\x80\\x80\\xff") << "beyond the last";
  EXPECT_EQ(printable("\xe2\x80"), "\\xe2\\x80") << "breaks off";
}

TEST(Printable, LineBreaksInNamesAreEscaped) {
  EXPECT_EQ(printable_name("a\npalpate: error: b\tc"), "a\\u000apalpate: error: b\\u0009c");
}

TEST(Printable, PiecewiseOutputEqualsTheWhole) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const std::string parts[] = {"\x1b", "\u009b", "\x9b", "\u202e", "\U000E0041",
                               "大",   "a",      "\n",   "\xc3",   "\xf0\x9f"};
  for (int run = 0; run < 2000; ++run) {
    std::string whole;
    for (int n = 0; n < 8; ++n) whole += parts[random() % std::size(parts)];
    whole += '\n';
    PrintableStream stream;
    std::string shown;
    for (std::string_view remaining = whole; !remaining.empty();) {
      const auto piece = remaining.substr(0, 1 + random() % 3);
      shown += stream.next(piece);
      remaining.remove_prefix(piece.size());
    }
    ASSERT_EQ(shown, printable(whole));
    for (const char c : shown) ASSERT_TRUE(c == '\n' || c == '\t' || static_cast<unsigned char>(c) >= ' ');
    ASSERT_EQ(printable(shown), shown);
  }
}

}  // namespace
}  // namespace palpate
