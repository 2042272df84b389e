#include <gtest/gtest.h>

#include "palpate/indentation/indentation.h"

namespace palpate {
namespace {

TEST(IndentationCurves, AreReadWithTheirSetupInAnyOrderOfColumns) {
  const auto curves = read_indentation_curves(
      "# liver, 2 mm/s\n"
      "curve, force_N, depth_mm, radius_mm, thickness_mm, base, preset\r\n"
      "a, 0.01, 0.1, 4, 15, bonded, liver\n"
      "a, 0.02, 0.2, 4, 15, bonded, liver\n"
      "\n"
      "\"b\", -0.001, 0, , , thick,\n",
      {3, {}, {}, "fat"}, "curves.csv");
  ASSERT_TRUE(curves.ok()) << curves.error().what;
  ASSERT_EQ(curves->size(), 2u);
  EXPECT_EQ((*curves)[0].name, "a");
  EXPECT_EQ((*curves)[0].preset, "liver");
  EXPECT_EQ((*curves)[0].depth_mm, (std::vector<double>{0.1, 0.2}));
  EXPECT_EQ((*curves)[0].force_N, (std::vector<double>{0.01, 0.02}));
  EXPECT_TRUE((*curves)[0].time_s.empty());
  EXPECT_EQ((*curves)[0].setup.radius_mm, 4);
  EXPECT_EQ((*curves)[0].setup.thickness_mm, 15);
  EXPECT_EQ((*curves)[0].setup.base, SpecimenBase::kBonded);
  EXPECT_EQ((*curves)[1].setup.radius_mm, 3) << "the option, where the table says nothing";
  EXPECT_EQ((*curves)[1].setup.base, SpecimenBase::kThick);
  EXPECT_EQ((*curves)[1].force_N, (std::vector<double>{-0.001}));
}

TEST(IndentationCurves, ErrorsNameTheLine) {
  struct Bad {
    const char *text, *what, *where;
  };
  const CurveDefaults radius{4, {}, {}, ""};
  for (const auto& [text, what, where] : {
           Bad{"", "holds no sample", "c.csv"},
           Bad{"depth,force\n", "unknown column \"depth\"", "c.csv:1"},
           Bad{"depth_mm,depth_mm\n", "two columns", "c.csv:1"},
           Bad{"depth_mm,time_s\n", "no column force_N", "c.csv:1"},
           Bad{"depth_mm,force_N\n1,2,3\n", "3 fields for 2 columns", "c.csv:2"},
           Bad{"depth_mm,force_N\n\n1,two\n", "force_N is \"two\", not a number", "c.csv:3"},
           Bad{"depth_mm,force_N\n1,nan\n", "not a number", "c.csv:2"},
           Bad{"depth_mm,force_N,time_s\n1,1,0\n1,1,0\n", "time_s does not increase", "c.csv:3"},
           Bad{"depth_mm,force_N,curve\n1,1,a\n1,1,b\n1,1,a\n", "begins again", "c.csv:4"},
           Bad{"depth_mm,force_N,radius_mm\n1,1,-4\n", "radius_mm is \"-4\"", "c.csv:2"},
           Bad{"depth_mm,force_N,base\n1,1,glued\n", "base is \"glued\"", "c.csv:2"},
           Bad{"depth_mm,force_N,base\n1,1,bonded\n", "not the thickness", "c.csv:2"},
           Bad{"depth_mm,force_N,thickness_mm\n1,1,10\n", "not what the specimen lies on", "c.csv:2"},
       }) {
    const auto read = read_indentation_curves(text, radius, "c.csv");
    ASSERT_FALSE(read.ok()) << text;
    EXPECT_NE(read.error().what.find(what), std::string::npos) << read.error().what;
    EXPECT_EQ(read.error().where, where) << text;
    EXPECT_FALSE(read.error().remedy.empty()) << text;
  }
  EXPECT_FALSE(read_indentation_curves("depth_mm,force_N\n1,1\n", {}, "c.csv").ok()) << "no radius";
}

}  // namespace
}  // namespace palpate
