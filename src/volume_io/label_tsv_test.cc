#include <gtest/gtest.h>

#include "palpate/volume_io.h"

namespace palpate {
namespace {

TEST(LabelTsv, ReadsValueAndName) {
  const auto labels = parse_label_tsv("value\tname\n1\tfemoral_cartilage\n5\tfemur\n", "labels.tsv");
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->size(), 2u);
  EXPECT_EQ((*labels)[1].value, 5);
  EXPECT_EQ((*labels)[1].name, "femur");
  EXPECT_FALSE((*labels)[1].colour);
}

TEST(LabelTsv, ReadsTheColumnsOfBidsInAnyOrderWithColours) {
  const auto labels = parse_label_tsv(
      "\xEF\xBB\xBFindex\tabbreviation\tName\tcolor\r\n"
      "1\tGM\tGray Matter\t#ff0035\r\n"
      "\r\n"
      "2\tWM\tWhite Matter\tn/a",
      "dseg.tsv");
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->size(), 2u);
  EXPECT_EQ((*labels)[0].name, "Gray Matter");
  EXPECT_EQ((*labels)[0].colour, (Rgb{255, 0, 0x35}));
  EXPECT_FALSE((*labels)[1].colour);

  const auto rgb = parse_label_tsv("id\tr\tg\tb\tname\n7\t1\t2\t3\tmuscle\n8\t\t\t\tfat\n", "t");
  ASSERT_TRUE(rgb) << rgb.error().message();
  EXPECT_EQ((*rgb)[0].colour, (Rgb{1, 2, 3}));
  EXPECT_FALSE((*rgb)[1].colour);
}

TEST(LabelTsv, AHeadingWithoutValueOrNameOrWithOneTwiceIsAnError) {
  for (const char* heading : {"", "value", "name", "value name", "value\tlabel\tname", "value\tname\tname",
                              "value\tname\tr\tg", "1\tfemur"}) {
    const auto labels = parse_label_tsv(std::string(heading) + "\n", "t.tsv");
    ASSERT_FALSE(labels) << heading;
    EXPECT_EQ(labels.error().where, "t.tsv:1");
  }
}

TEST(LabelTsv, EveryFaultNamesItsLine) {
  for (const char* bad : {"2", "2\tb\tc\td", "x\tb\t", "-2\tb\t", "65536\tb\t", "2\t\t", "1\tb\t",
                          "2\tb\tred", "2\tb\t#12345", "2\tb\t#12345g", "2\tb\t#-1-1-1"}) {
    const auto labels =
        parse_label_tsv("value\tname\tcolor\n1\ta\t#000000\n" + std::string(bad) + "\n", "t.tsv");
    ASSERT_FALSE(labels) << bad;
    EXPECT_EQ(labels.error().where, "t.tsv:3") << bad;
  }
}

}  // namespace
}  // namespace palpate
