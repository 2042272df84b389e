#include "palpation/script_text.h"

#include <gtest/gtest.h>

namespace palpate {
namespace {

TEST(ScriptText, ParsesBackToTheSameScript) {
  const auto script = parse_script(
      "title = \"a \\\"quoted\\\" \\u0007 title\"\ndevice = \"touch\"\nrate = 4000\ndelay = 2.5\nseed = "
      "99\ntremor = 0.1\n"
      "[[step]]\napproach = \"femur\"\nspeed = 33.3\n[[step]]\npress = 0.1\n[[step]]\nhold = 1\n"
      "[[step]]\nmethod = \"b-spline\"\n[[step]]\nslide = 4\ndirection = [1.0, 2.0, -0.5]\n[[step]]\nrotate "
      "= 12.5\n[[step]]\nleave = "
      "true\nspeed = 7\n[[step]]\napproach = [1.0, -2.5, 3.0]\nfrom = \"left\"\n[[step]]\nleave = true\n"
      "[[step]]\napproach = \"femur\"\nlandmark = \"right\"\n[[step]]\nleave = true\n"
      "[[step]]\napproach = \"femur\"\nnearest = \"#7\"\n[[step]]\nleave = true\n"
      "[[step]]\napproach = \"femur\"\nnearest = [0.0, 0.1, 2.0]\n[[step]]\nleave = true\n[[step]]\nlaw = "
      "\"neo-hookean\"\n[[step]]\nscope = [1.0, 2.5, -3.0]\nfrom = [1.0, 2.0, 0.5]\noptics = "
      "0\n[[step]]\nscope "
      "= \"probe\"\ndistance = 30\n",
      "script");
  ASSERT_TRUE(script.ok()) << script.error().message();
  const std::string text = script_text(*script);
  const auto again = parse_script(text, "again");
  ASSERT_TRUE(again.ok()) << again.error().message() << "\n" << text;
  EXPECT_EQ(script_text(*again), text);
  EXPECT_EQ(again->title, script->title);
  EXPECT_EQ(again->seed, 99u);
  EXPECT_EQ(again->rate_hz, 4000);
  EXPECT_DOUBLE_EQ(again->delay_s, 2.5e-3);
  ASSERT_EQ(again->steps.size(), script->steps.size());
  EXPECT_EQ(std::get<ApproachStep>(again->steps[0]).speed_mm_s, 33.3);
  EXPECT_EQ(std::get<PressStep>(again->steps[1]).force_N, 0.1);
  const auto approach = [&](std::size_t s) { return std::get<ApproachStep>(again->steps[s]); };
  EXPECT_EQ(approach(7).point, Point<Patient>(1, -2.5, 3));
  EXPECT_EQ(approach(7).from, Vector<Patient>(1, 0, 0));
  EXPECT_EQ(approach(9).landmark, Vector<Patient>(-1, 0, 0));
  EXPECT_EQ(std::get<std::string>(approach(11).nearest), "#7");
  EXPECT_EQ(std::get<Point<Patient>>(approach(13).nearest), Point<Patient>(0, 0.1, 2));
  EXPECT_EQ(std::get<ScopeStep>(again->steps[16]).at, Point<Patient>(1, 2.5, -3));
  EXPECT_EQ(std::get<ScopeStep>(again->steps[16]).optics.lean_deg, 0);
  EXPECT_FALSE(std::get<ScopeStep>(again->steps[17]).at);
  EXPECT_EQ(std::get<ScopeStep>(again->steps[17]).distance_mm, 30);
  EXPECT_EQ(std::get<LawStep>(again->steps[15]).law, TissueLaw::kNeoHookean);
  EXPECT_EQ(std::get<MethodStep>(again->steps[3]).method, ForceMethod::kSpline);
  EXPECT_LT((std::get<SlideStep>(again->steps[4]).direction.normalized() -
             std::get<SlideStep>(script->steps[4]).direction.normalized())
                .norm(),
            1e-12);
}

}  // namespace
}  // namespace palpate
