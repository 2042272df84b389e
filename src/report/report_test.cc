#include "palpate/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>

#include "report/example_run.h"

namespace palpate::report {
namespace {

using testing::HasSubstr;
using testing::Not;

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

class Report : public testing::Test {
 protected:
  std::string page() const {
    const auto html = report_html(recording, model);
    EXPECT_TRUE(html.ok()) << (html.ok() ? "" : html.error().message());
    return html.ok() ? *html : "";
  }
  static Model shared_model() {
    static const Model model = example::model();  // its volumes are shared by the copies
    return model;
  }
  Model model = shared_model();
  Recording recording = example::recording(model);
};

TEST_F(Report, SaysWhatTheRunWas) {
  const std::string html = page();
  for (const std::string text : {"not for clinical use", "Simulated hand", "Example knee", "LEFT",
                                 "0123456789abcdef", "5eed5eed5eed5eed", "0123456789ab", "20240517",
                                 "premium-1.5", "firm-grip", "GNU 12.2.0", "AVX2", "2024-05-17T09:30:00Z"}) {
    EXPECT_THAT(html, HasSubstr(text));
  }
  EXPECT_THAT(html, Not(HasSubstr("cut short")));
}

TEST_F(Report, ShowsThreeSectionsOfEachTouchedStructure) {
  const std::string html = page();
  // tibia, femoral cartilage, patella, fibula
  EXPECT_EQ(count(html, "role=\"tab\""), 4u);
  EXPECT_EQ(count(html, "role=\"tabpanel\""), 4u);
  EXPECT_EQ(count(html, "<figure class=\"section\">"), 12u);
  EXPECT_EQ(count(html, "src=\"data:image/png;base64,"), 24u);
  EXPECT_EQ(count(html, ">10 mm</text>"), 12u);
  EXPECT_EQ(count(html, ">LEFT</text>"), 12u);
}

TEST_F(Report, IsTheSameEachTimeAndSmall) {
  const std::string html = page();
  EXPECT_EQ(html, page());
  EXPECT_LT(html.size(), 3'000'000u);
}

TEST_F(Report, LoadsNothing) {
  const std::string html = page();
  // the one address is the plotting library's own name in its licence line
  EXPECT_EQ(count(html, "://"), 1u);
  EXPECT_THAT(html, HasSubstr("/*! https://github.com/leeoniya/uPlot (v1.6.32) */"));
  EXPECT_EQ(count(html, "src="), count(html, "src=\"data:"));
  EXPECT_THAT(html, HasSubstr("default-src 'none'"));
  EXPECT_THAT(html, Not(HasSubstr("unsafe-inline")));
  EXPECT_THAT(html, Not(HasSubstr("@import")));
}

TEST_F(Report, NamesCannotBringMarkup) {
  const std::string evil = "</script></title><img src=x onerror=alert(1)>\"'&";
  for (auto& structure : recording.header.structures) structure.name = evil;
  for (std::string* field :
       {&recording.header.scene_title, &recording.header.data_set, &recording.header.device,
        &recording.header.hand, &recording.header.started_utc, &recording.header.commit,
        &recording.header.palpate_version, &recording.header.build_type, &recording.header.compiler,
        &recording.header.simd_target, &recording.header.script_text}) {
    *field = evil;
  }
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("&lt;img src=x onerror=alert(1)&gt;"));
  EXPECT_THAT(html, Not(HasSubstr("<img src=x")));
  // the data block and the two programs, and nothing that closes them early
  EXPECT_EQ(count(html, "</script>"), 3u);
  EXPECT_EQ(count(html, "</title>"), 1u);
}

TEST_F(Report, ANamelessStructureIsItsLabel) {
  for (auto& structure : recording.header.structures) structure.name.clear();
  for (Segment& segment : model.segments) segment.name.clear();
  EXPECT_THAT(page(), HasSubstr("label 97"));
}

TEST_F(Report, UnknownSideIsSaid) {
  model.side = Side::kUnknown;
  const std::string html = page();
  EXPECT_EQ(count(html, ">SIDE UNKNOWN</text>"), 12u);
  EXPECT_EQ(count(html, ">LEFT<"), 0u);
}

TEST_F(Report, ARealDeviceIsNotCalledSimulated) {
  recording.header.simulated = false;
  recording.header.hand.clear();
  EXPECT_THAT(page(), Not(HasSubstr("imulated")));
}

TEST_F(Report, ACutShortRecordingSaysSo) {
  recording.summary.reset();
  recording.ticks.resize(4000);
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("This recording was cut short"));
  EXPECT_EQ(count(html, "role=\"tab\""), 2u);
}

TEST_F(Report, AnEmptyOrUntouchedRunIsStillAPage) {
  recording.ticks.resize(300);  // on the way to the first structure
  EXPECT_THAT(page(), HasSubstr("No structure was touched"));
  recording.ticks.clear();
  EXPECT_THAT(page(), HasSubstr("The recording holds no tick"));
}

TEST_F(Report, DamagedNumbersDoNotReachThePage) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  recording.header.rate_hz = kNan;
  recording.header.devices = 99;
  for (std::size_t i = 700; i < recording.ticks.size(); i += 3) {
    TickRecord& tick = recording.ticks[i];
    tick.time_s = kNan;
    tick.max_force_N = -1e300;
    tick.rotation_felt_wxyz = {0, 0, 0, 0};
    tick.device[0].force_N = {kNan, 1e308, -1e308};
    tick.device[0].tip_patient_mm = {1e300, kNan, -1e300};
    tick.device[0].velocity_patient_mm_s = {kNan, 0, 0};
    tick.device[0].depth_mm = kNan;
    tick.device[0].label = 65535;
  }
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("label 65535"));
  // as an attribute's value, as text, or in the data
  for (const std::string word : {"nan", "inf"}) {
    for (const std::string before : {"\"", "\"-", ">", ">-", ",", ",-", "[", " ", " -"}) {
      for (const std::string after : {"\"", "<", ",", "]", " "}) {
        EXPECT_THAT(html, Not(HasSubstr(before + word + after)));
      }
    }
  }
}

TEST_F(Report, WorksWithoutScanAndLabels) {
  model.scan.reset();
  EXPECT_EQ(count(page(), "<figure class=\"section\">"), 12u);
  model.labels.reset();
  EXPECT_EQ(count(page(), "<figure class=\"section\">"), 12u);
}

TEST_F(Report, AnotherModelIsRefused) {
  recording.header.model_hash ^= 1;
  const auto html = report_html(recording, model);
  ASSERT_FALSE(html.ok());
  EXPECT_EQ(html.error().kind, ErrorKind::kBadInput);
  EXPECT_THAT(html.error().what, HasSubstr("another model"));
  EXPECT_FALSE(html.error().remedy.empty());
}

TEST_F(Report, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto html = report_html(recording, model, Progress({}, &stop));
  ASSERT_FALSE(html.ok());
  EXPECT_EQ(html.error().kind, ErrorKind::kInterrupted);
}

TEST_F(Report, IsWrittenWholeOrNotAtAll) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "palpate_report_test";
  std::filesystem::create_directories(folder);
  ASSERT_TRUE(write_report(folder / "run.html", recording, model).ok());
  std::ifstream stream(folder / "run.html", std::ios::binary);
  const std::string written{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(written, page());

  const auto failed = write_report(folder / "absent" / "run.html", recording, model);
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().kind, ErrorKind::kOutput);
  recording.header.model_hash ^= 1;
  EXPECT_FALSE(write_report(folder / "other.html", recording, model).ok());
  EXPECT_FALSE(std::filesystem::exists(folder / "other.html"));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace palpate::report
