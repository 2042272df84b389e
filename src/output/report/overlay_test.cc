#include "report/overlay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "palpate/recording/recording_source.h"
#include "report/test_example_run.h"

namespace palpate::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

// 1 mm is 4 px, the centre at (200, 200) in the drawing
SectionPlane axial() {
  return anatomical_section(AnatomicalPlane::kAxial, Point<Patient>(1, 2, 3), 100, 400, 400);
}

TEST(Overlay, MarksStandWhereTheyBelong) {
  SectionMarks marks;
  marks.contact = Point<Patient>(1, 2, 3);
  marks.force_N = Vector<Patient>(0, -2, 0);  // anterior: up in an axial view
  marks.arrow_mm_per_N = 5;
  marks.side = Side::kLeft;
  const std::string svg = section_svg(axial(), marks, "A <section>");
  EXPECT_THAT(svg, HasSubstr("class=\"contact\" cx=\"200.0\" cy=\"200.0\""));
  // 2 N at 5 mm/N are 40 px
  EXPECT_THAT(svg, HasSubstr("class=\"force-head\" points=\"200.0,160.0 "));
  // 10 mm are 40 px
  EXPECT_THAT(svg, HasSubstr("class=\"scale\" x1=\"14.0\" y1=\"384.0\" x2=\"54.0\" y2=\"384.0\""));
  EXPECT_THAT(svg, HasSubstr(">10 mm</text>"));
  for (const std::string letter : {"R", "L", "A", "P"}) EXPECT_THAT(svg, HasSubstr(">" + letter + "</text>"));
  // lower right, away from the letter L at half height and from the letter at the bottom centre
  EXPECT_THAT(svg, HasSubstr("<text class=\"side-mark\" x=\"390.0\" y=\"388.0\">Side: LEFT</text>"));
  EXPECT_THAT(svg, HasSubstr("aria-label=\"A &lt;section&gt;\""));
}

TEST(Overlay, DoubtsStandAboveTheSide) {
  SectionMarks marks;
  marks.contact = axial().centre;
  marks.side = Side::kLeft;
  marks.doubts = {"PLACEMENT IN DOUBT", "SIDE IN DOUBT"};
  const std::string svg = section_svg(axial(), marks, "");
  EXPECT_THAT(svg, HasSubstr("y=\"356.0\">PLACEMENT IN DOUBT</text>"));
  EXPECT_THAT(svg, HasSubstr("y=\"372.0\">SIDE IN DOUBT</text>"));
  EXPECT_THAT(svg, HasSubstr("y=\"388.0\">Side: LEFT</text>"));
}

TEST(Overlay, ForceAcrossThePlaneIsDrawnEndOn) {
  SectionMarks marks;
  marks.contact = axial().centre;
  // an axial view looks from the feet to the head: a superior force points away from the viewer
  marks.force_N = Vector<Patient>(0, 0, 1);
  const std::string away = section_svg(axial(), marks, "");
  marks.force_N = Vector<Patient>(0, 0, -1);
  const std::string towards = section_svg(axial(), marks, "");
  EXPECT_THAT(away, HasSubstr("class=\"end-on\""));
  EXPECT_THAT(away, Not(HasSubstr("force-head")));
  EXPECT_THAT(towards, HasSubstr("class=\"end-on\""));
  EXPECT_THAT(towards, HasSubstr("force-head"));
  marks.force_N = Vector<Patient>();
  EXPECT_THAT(section_svg(axial(), marks, ""), Not(HasSubstr("class=\"end-on\"")));
}

TEST(Overlay, OnlyTheWayNearThePlaneIsDrawn) {
  SectionMarks marks;
  marks.contact = axial().centre;
  // down through the plane along z, then along x within it
  PathSection section{false, {}};
  for (int i = -20; i <= 0; ++i) section.points.emplace_back(1, 2, 3.0 + i);
  for (int i = 1; i <= 10; ++i) section.points.emplace_back(1.0 + i, 2, 3);
  marks.paths = {section};
  const std::string svg = section_svg(axial(), marks, "");
  EXPECT_THAT(svg, HasSubstr("<polyline class=\"way\" points=\"200.0,200.0 204.0,200.0 208.0,200.0"));
  EXPECT_THAT(svg, HasSubstr("240.0,200.0\""));

  for (Point<Patient>& p : section.points) p[2] -= 5.5;
  marks.paths = {section};
  EXPECT_THAT(section_svg(axial(), marks, ""), Not(HasSubstr("polyline")));
}

template <class OnTick>
void add_paths(const Recording& recording, OnTick&& observe) {
  TickTimes times(RecordingSource(recording).head());
  times.take(recording.ticks, observe);
  times.finish(observe);
}

// first contact of a recording
Contact first_contact(const Recording& recording) {
  ContactFinder finder(1);
  add_paths(recording, [&](const TimedTick& now) { finder.observe(now); });
  const auto contacts = finder.finish();
  EXPECT_FALSE(contacts.empty());
  return contacts.empty() ? Contact{} : contacts.front();
}

std::vector<PathSection> path_around(const Recording& recording, const Contact& contact) {
  PathRecorder follower(contact);
  add_paths(recording, [&](const TimedTick& now) { follower.observe(now); });
  return follower.finish();
}

TEST(Overlay, WayIsCutWhereTheContactBeginsAndEnds) {
  const Model model = example::model();
  const Recording recording = example::recording(model);
  const Contact contact = first_contact(recording);
  const auto paths = path_around(recording, contact);
  ASSERT_EQ(paths.size(), 3u);
  EXPECT_FALSE(paths[0].touching);
  EXPECT_TRUE(paths[1].touching);
  EXPECT_FALSE(paths[2].touching);
  // the contact section shares a point with the one before it
  EXPECT_EQ(paths[1].points.size(), contact.last - contact.first + 2);
  EXPECT_EQ(paths[1].points.front(), paths[0].points.back());
  EXPECT_NEAR(static_cast<double>(paths[2].points.size()), 1001, 2);  // a second after it
}

TEST(Overlay, LongPathKeepsEndsAndFewPoints) {
  // a long contact: 300 000 ticks along a line
  Recording recording;
  recording.ticks.resize(300'000);
  for (std::size_t i = 0; i < recording.ticks.size(); ++i) {
    TickRecord& tick = recording.ticks[i];
    tick.tick = i;
    tick.time_s = 1e-3 * static_cast<double>(i);
    tick.device[0].tip_patient_mm = {1e-3 * static_cast<double>(i), 0, 0};
    if (i < 5000 || i >= 290'000) continue;
    tick.device[0].label = 3;
    tick.device[0].flags = kFlagContact;
  }
  const auto paths = path_around(recording, first_contact(recording));
  ASSERT_EQ(paths.size(), 3u);
  const auto& points = paths[1].points;
  std::size_t all = 0;
  for (const PathSection& section : paths) all += section.points.size();
  EXPECT_LE(all, kMaxOverlayPoints);
  EXPECT_GT(points.size(), kMaxOverlayPoints / 4);
  EXPECT_NEAR(points.front().x(), 4.999, 1e-9);
  EXPECT_NEAR(points.back().x(), 289.999, 1e-9);
  for (std::size_t i = 1; i < points.size(); ++i) {
    ASSERT_GT(points[i].x(), points[i - 1].x());
    ASSERT_LT(points[i].x() - points[i - 1].x(), 0.065);
  }
}

TEST(Overlay, ForceIsTurnedBackWithTheObject) {
  const Model model = example::model();
  TickRecord tick;
  // the object is rotated by 90 degrees about its superior-up axis; anterior, which is up, is unchanged
  const double h = std::sqrt(0.5);
  tick.rotation_applied_wxyz = {h, 0, 0, h};
  tick.device[0].force_N = {0, 0, 2};
  EXPECT_NEAR((patient_force_N(model, tick, 0) - Vector<Patient>(0, -2, 0)).norm(), 0, 1e-12);
  // the former right (the patient's left) now points forward
  tick.device[0].force_N = {0, 3, 0};
  EXPECT_NEAR((patient_force_N(model, tick, 0) - Vector<Patient>(3, 0, 0)).norm(), 0, 1e-12);
  tick.device[0].force_N = {NAN, 0, 0};
  EXPECT_EQ(patient_force_N(model, tick, 0), Vector<Patient>());
}

TEST(Overlay, SideIsNeverGuessed) {
  SectionMarks marks;
  marks.contact = axial().centre;
  EXPECT_THAT(section_svg(axial(), marks, ""), HasSubstr(">SIDE UNKNOWN</text>"));
}

TEST(Overlay, BothSidesNeedNoMarkButLetters) {
  SectionMarks marks;
  marks.contact = axial().centre;
  marks.side = Side::kBoth;
  const std::string svg = section_svg(axial(), marks, "");
  EXPECT_THAT(svg, Not(HasSubstr("side-mark")));
  for (const std::string letter : {"R", "L", "A", "P"}) EXPECT_THAT(svg, HasSubstr(">" + letter + "</text>"));
}

TEST(Overlay, WithoutOrientationThereAreNoLetters) {
  SectionMarks marks;
  marks.contact = axial().centre;
  marks.side = Side::kLeft;
  marks.oriented = false;
  const std::string svg = section_svg(axial(), marks, "");
  EXPECT_THAT(svg, HasSubstr(">ORIENTATION UNKNOWN</text>"));
  for (const std::string letter : {"R", "L", "A", "P", "S", "I"})
    EXPECT_THAT(svg, Not(HasSubstr(">" + letter + "</text>")));
  EXPECT_THAT(svg, Not(HasSubstr("LEFT")));
}

}  // namespace
}  // namespace palpate::report
