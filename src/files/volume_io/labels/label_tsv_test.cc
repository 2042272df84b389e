#include <gtest/gtest.h>

#include "palpate/volume_io/label_tables.h"

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

TEST(LabelCsv, ReadsCommasSemicolonsAndQuotationMarks) {
  const auto labels = parse_label_csv(
      "\xEF\xBB\xBFLabelValue,Name,Color_R,Color_G,Color_B,Color_A\r\n"
      "1,\"femur, left\",1,2,3,255\r\n"
      "\r\n"
      "2,\"the \"\"second\"\"\",4,5,6,255",
      "names.csv");
  ASSERT_TRUE(labels) << labels.error().message();
  ASSERT_EQ(labels->size(), 2u);
  EXPECT_EQ((*labels)[0].name, "femur, left");
  EXPECT_EQ((*labels)[0].colour, (Rgb{1, 2, 3}));
  EXPECT_EQ((*labels)[1].name, "the \"second\"");

  const auto semicolons = parse_label_csv("name;id\nfemur;5\n", "names.csv");
  ASSERT_TRUE(semicolons) << semicolons.error().message();
  EXPECT_EQ((*semicolons)[0].value, 5);
  EXPECT_EQ((*semicolons)[0].name, "femur");
}

TEST(LabelCsv, EveryFaultNamesItsLine) {
  EXPECT_EQ(parse_label_csv("1,femur\n", "t.csv").error().where, "t.csv:1");
  for (const char* bad : {"2", "2,b,c,d", "x,b,", "65536,b,", "2,,", "1,b,", "2,b,red", "2,\"b,"}) {
    const auto labels = parse_label_csv("value,name,color\n1,a,#000000\n" + std::string(bad) + "\n", "t.csv");
    ASSERT_FALSE(labels) << bad;
    EXPECT_EQ(labels.error().where, "t.csv:3") << bad;
  }
}

}  // namespace
}  // namespace palpate
