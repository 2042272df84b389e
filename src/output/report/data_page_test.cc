#include "palpate/report/data_page.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(DataPage, ShowsEverySetAndNothingAsMarkup) {
  DataPage page;
  page.program = "1.0";
  page.sets = {{"knee", "a <left> knee", "none & free", "here", "", {0x89, 'P'}},
               {"head", "a head", "BSD", "not here: <fetch> it", "it is <damaged>", {}}};
  const std::string html = data_html(page);
  EXPECT_NE(html.find("a &lt;left&gt; knee"), std::string::npos);
  EXPECT_NE(html.find("none &amp; free"), std::string::npos);
  EXPECT_NE(html.find("it is &lt;damaged&gt;"), std::string::npos);
  EXPECT_EQ(html.find("<left>"), std::string::npos);
  EXPECT_EQ(html.find("<damaged>"), std::string::npos);
  EXPECT_EQ(html.find("<fetch>"), std::string::npos);
  EXPECT_NE(html.find("data:image/png;base64,iVA="), std::string::npos);
  EXPECT_NE(html.find("no picture"), std::string::npos);
  EXPECT_NE(html.find("Content-Security-Policy"), std::string::npos);
  // no scripts
  EXPECT_EQ(html.find("script-src"), std::string::npos);
  EXPECT_EQ(html.find("<script"), std::string::npos);
  EXPECT_NE(html.find("2 data sets"), std::string::npos);
  EXPECT_NE(html.find("not for clinical use"), std::string::npos);
}

}  // namespace
}  // namespace palpate
