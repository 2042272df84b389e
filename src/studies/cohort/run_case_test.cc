#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "base/test_folder.h"
#include "palpate/base/file.h"
#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_summary.h"
#include "palpate/cohort/cohort_table.h"

namespace palpate {
namespace {

TEST(RunCase, AKneeIsPreparedCheckedPalpatedAndDrawn) {
  const test::TemporaryFolder folder;
  const auto script = folder / "touch.toml";
  ASSERT_TRUE(write_file(
      script,
      "[[step]]\napproach = \"femur\"\nspeed = 200.0\n[[step]]\npress = 0.8\n[[step]]\nhold = 0.2\n"));
  CohortCase one;
  one.name = "a knee";
  one.target = "knee-phantom:spacing=2.5";
  one.script = script;
  const auto result = run_case(one, 1, folder / "out", {"1.0", false});
  ASSERT_TRUE(result) << result.error().message();
  EXPECT_EQ(result->fault, "");
  EXPECT_EQ(result->palpated, 1);
  EXPECT_EQ(result->held, 1);
  EXPECT_EQ(result->failed_steps, 0);
  const auto femur = std::ranges::find(result->structures, "femur", &StructureResult::name);
  ASSERT_NE(femur, result->structures.end());
  EXPECT_GT(femur->volume_mm3, 50'000);
  EXPECT_GT(femur->thinnest_mm, 10);
  EXPECT_NEAR(femur->mean_force_N, 0.8, 0.2);
  const auto key = case_key(one, "1.0");
  ASSERT_TRUE(key);
  const auto found = find_case(folder / "out", 1, *key);
  ASSERT_TRUE(found);
  EXPECT_EQ(case_json(*found), case_json(*result));
  EXPECT_FALSE(find_case(folder / "out", 1, "another"));
  EXPECT_FALSE(find_case(folder / "out", 2, *key));
  EXPECT_TRUE(std::filesystem::exists(case_folder(folder / "out", 1) / "picture.png"));
  EXPECT_FALSE(std::filesystem::exists(case_folder(folder / "out", 1) / "run.h5"));

  // a failure is a result as well
  CohortCase broken;
  broken.name = "broken";
  broken.target = (folder / "DOE-CANARY.nrrd").string();
  ASSERT_TRUE(write_file(broken.target, "NRRD0004\ntype: uint8\n"));
  const auto fault = run_case(broken, 2, folder / "out", {"1.0", false});
  ASSERT_TRUE(fault);
  EXPECT_NE(fault->fault, "");
  EXPECT_EQ(fault->fault.find("CANARY"), std::string::npos);
  CohortCase lacks = one;
  ASSERT_TRUE(write_file(script, "[[step]]\napproach = \"no such bone\"\n"));
  const auto half = run_case(lacks, 3, folder / "out", {"1.0", false});
  ASSERT_TRUE(half);
  EXPECT_NE(half->fault.find("no such bone"), std::string::npos);
  EXPECT_FALSE(half->structures.empty()) << "what is known of it stands there";

  CohortResults cohort{{one, broken, lacks, one}, {*result, *fault, *half, std::nullopt}};
  const std::string tsv = cohort_tsv(cohort);
  EXPECT_EQ(std::ranges::count(tsv, '\n'), 5);
  // every row has the same number of fields
  std::size_t fields = 0;
  for (std::string_view remaining = tsv; !remaining.empty();) {
    const auto end = remaining.find('\n');
    const auto here = static_cast<std::size_t>(std::ranges::count(remaining.substr(0, end), '\t'));
    if (fields == 0) fields = here;
    EXPECT_EQ(here, fields);
    remaining.remove_prefix(end + 1);
  }
  const std::string page = cohort_page(cohort, folder / "out", "1.0");
  EXPECT_NE(page.find("data:image/png;base64,"), std::string::npos);
  EXPECT_NE(page.find("no such bone"), std::string::npos);
  EXPECT_EQ(page.find("CANARY"), std::string::npos);
}

}  // namespace
}  // namespace palpate
