#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "palpate/cohort/cohort_table.h"

namespace palpate {
namespace {

TEST(CohortTable, DetectsTheSeparator) {
  const std::vector<std::string> texts{
      "# of "
      "March\nstudy\tsegmentation\tcase\tseed\tmax_force\n\nscan.nii.gz\tlabels.nii.gz\tA\t7\t2.5\nknee-"
      "phantom:side=right\t\tB\tn/a\t\n",
      "study,segmentation,case,seed,max_force\r\n\"scan.nii.gz\",labels.nii.gz,A,7,2.5\r\nknee-phantom:side="
      "right,,B,,\r\n",
      "study;segmentation;case;seed;max_force\nscan.nii.gz;labels.nii.gz;\"A\";7;2.5\n\"knee-phantom:side="
      "right\";;B\n"};
  for (const std::string& text : texts) {
    const auto cases = parse_cohort_table(
        text, "cases", "/data", [](const std::string& name) { return name.starts_with("knee-phantom"); });
    ASSERT_TRUE(cases) << cases.error().message();
    ASSERT_EQ(cases->size(), 2u);
    EXPECT_EQ(cases->at(0).target, "/data/scan.nii.gz");
    EXPECT_EQ(cases->at(0).segmentation, "/data/labels.nii.gz");
    EXPECT_EQ(cases->at(0).name, "A");
    EXPECT_EQ(cases->at(0).seed, 7u);
    EXPECT_EQ(cases->at(0).max_force_N, 2.5);
    EXPECT_EQ(cases->at(1).target, "knee-phantom:side=right");
    EXPECT_FALSE(cases->at(1).segmentation);
    EXPECT_FALSE(cases->at(1).seed);
  }
  const auto plain = parse_cohort_table("study\na.nrrd\n/b.nrrd\n", "cases", "");
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->at(0).name, "1");
  EXPECT_EQ(plain->at(1).name, "2");
  EXPECT_EQ(plain->at(1).target, "/b.nrrd");
  const auto named = parse_cohort_table("study\tlabels\tnames\na\tb\tc.csv\n", "cases", "/data");
  ASSERT_TRUE(named);
  EXPECT_EQ(named->at(0).names, "/data/c.csv");
}

TEST(CohortTable, EachFaultIsNamedWithItsLine) {
  struct Bad {
    std::string text, where, what;
  };
  for (const Bad& bad :
       std::vector<Bad>{{"", "cases", "has no case"},
                        {"study\n", "cases", "has no case"},
                        {"case\tsegmentation\nA\tb\n", "cases:1", "the column study is missing"},
                        {"study\tcolour\n", "cases:1", "no column \"colour\""},
                        {"study\tscan\n", "cases:1", "repeated"},
                        {"study\na\tb\n", "cases:2", "2 fields"},
                        {"study\tseed\na\t-1\n", "cases:2", "is not a number"},
                        {"study\tseed\na\t1.5\n", "cases:2", "is not a number"},
                        {"study\tmax_force\na\tnan\n", "cases:2", "is not a number"},
                        {"study\tmax_force\na\t1e9\n", "cases:2", "is not a number"},
                        {"study\tmethod\na\tmagic\n", "cases:2", "not a force method"},
                        {"study\tcase\na\tA\nb\tA\n", "cases:3", "two cases"},
                        {"study,case\n\"a,A\n", "cases:2", "quotation"},
                        {"study\tcase\na\t\x1b[2J\n", "cases:2", "cannot be shown"},
                        {"case\tstudy\nA\t\n", "cases:2", "has no study"}}) {
    const auto cases = parse_cohort_table(bad.text, "cases", "");
    ASSERT_FALSE(cases) << bad.text;
    EXPECT_EQ(cases.error().where, bad.where) << bad.text;
    EXPECT_NE(cases.error().what.find(bad.what), std::string::npos) << cases.error().what;
  }
}

}  // namespace
}  // namespace palpate
