#include "palpate/report/lint_page.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(LintPage, ShowsEveryFindingAndNothingAsMarkup) {
  LintPage page;
  page.program = "1.0";
  page.grade = "C";
  page.structures = {{"liver & <one>", {10, 20, 30}, "C", 1234, 5678, 1, 0, 0}};
  page.findings = {{"Islands",
                    "fault",
                    "liver & <one> has 2 islands",
                    "a grain",
                    "remove them",
                    "1, 2, 3 mm",
                    {0x89, 'P'}},
                   {"Swapped", "cannot tell", "no names", "left", "name them", "", {}}};
  page.kinds = {{"Islands", "Parts below 2 %."}};
  const std::string html = lint_html(page);
  EXPECT_NE(html.find("liver &amp; &lt;one&gt; has 2 islands."), std::string::npos);
  EXPECT_EQ(html.find("<one>"), std::string::npos);
  EXPECT_NE(html.find("Parts below 2 %."), std::string::npos);
  EXPECT_NE(html.find("#0a141e"), std::string::npos);
  EXPECT_NE(html.find("data:image/png;base64,iVA="), std::string::npos);
  EXPECT_NE(html.find("Content-Security-Policy"), std::string::npos);
  EXPECT_NE(html.find("not for clinical use"), std::string::npos);
}

}  // namespace
}  // namespace palpate
