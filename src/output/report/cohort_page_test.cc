#include "palpate/report/cohort_page.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate {
namespace {

TEST(CohortPage, ShowsEveryCaseAndNothingAsMarkup) {
  CohortPage page;
  page.program = "1.0";
  page.columns = {{"", "volume", "mm3", 1}, {"<femur>", "parts", "", 0}};
  page.rows = {{"knee & <one>", "done", "", {"a \"note\""}, {12.345, 2}, {0x89, 'P'}},
               {"two", "failed", "it is <damaged>", {}, {std::nan(""), std::nan("")}, {}}};
  const std::string html = cohort_html(page);
  EXPECT_NE(html.find("knee &amp; &lt;one&gt;"), std::string::npos);
  EXPECT_NE(html.find("&lt;femur&gt;"), std::string::npos);
  EXPECT_NE(html.find("it is &lt;damaged&gt;"), std::string::npos);
  EXPECT_EQ(html.find("<one>"), std::string::npos);
  EXPECT_EQ(html.find("<damaged>"), std::string::npos);
  EXPECT_NE(html.find("<td>12.3</td>"), std::string::npos);
  // a missing value is an empty cell
  EXPECT_NE(html.find("<td></td>"), std::string::npos);
  EXPECT_NE(html.find("Content-Security-Policy"), std::string::npos);
  EXPECT_NE(html.find("not for clinical use"), std::string::npos);
}

}  // namespace
}  // namespace palpate
