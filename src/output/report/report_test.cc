#include "palpate/report/report.h"
#include "palpate/recording/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "base/test_folder.h"
#include "base/test_process.h"
#include "report/test_example_run.h"

namespace palpate::report {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

class Report : public ::testing::Test {
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

TEST_F(Report, StatesTheRun) {
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
  // and one picture of the volume, and one per contact
  EXPECT_EQ(count(html, "src=\"data:image/png;base64,"), 29u);
  EXPECT_EQ(count(html, ">10 mm</text>"), 12u);
  EXPECT_EQ(count(html, ">Side: LEFT</text>"), 12u);
}

TEST_F(Report, IsTheSameEachTimeAndSmall) {
  const std::string html = page();
  EXPECT_EQ(html, page());
  EXPECT_LT(html.size(), 3'000'000u);
}

TEST_F(Report, LoadsNothing) {
  const std::string html = page();
  // the only URL is in the licence line of the plotting library
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
        &recording.header.simd_target, &recording.header.script_text, &recording.header.scheduler}) {
    *field = evil;
  }
  recording.summary->problems = {evil};
  recording.header.clock = "real";
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("&lt;img src=x onerror=alert(1)&gt;"));
  EXPECT_THAT(html, Not(HasSubstr("<img src=x")));
  // the data block and the two scripts; nothing closes them early
  EXPECT_EQ(count(html, "</script>"), 3u);
  EXPECT_EQ(count(html, "</title>"), 1u);
}

TEST_F(Report, ANamelessStructureIsItsLabel) {
  for (auto& structure : recording.header.structures) structure.name.clear();
  for (Segment& segment : model.segments) segment.name.clear();
  EXPECT_THAT(page(), HasSubstr("label 97"));
}

TEST_F(Report, StatesAnUnknownSide) {
  model.side = Side::kUnknown;
  const std::string html = page();
  EXPECT_EQ(count(html, ">SIDE UNKNOWN</text>"), 12u);
  EXPECT_EQ(count(html, "LEFT"), 0u);
}

TEST_F(Report, BothSidesNeedNoMark) {
  model.side = Side::kBoth;
  const std::string html = page();
  EXPECT_EQ(count(html, "class=\"side-mark\""), 0u);
  EXPECT_EQ(count(html, "badge side"), 0u);
  EXPECT_EQ(count(html, "UNKNOWN"), 0u);
  EXPECT_EQ(count(html, ">L</text>"), 8u);  // axial and coronal
}

TEST_F(Report, StatesASideInferredFromAnatomy) {
  EXPECT_THAT(page(), HasSubstr("<span class=\"badge side\">LEFT</span>"));
  model.side_from_anatomy = true;
  EXPECT_THAT(page(), HasSubstr("<span class=\"badge side\">LEFT, from the fibula</span>"));
  // also if the side could not be inferred
  model.side = Side::kUnknown;
  EXPECT_THAT(page(), HasSubstr("<span class=\"badge side\">SIDE UNKNOWN</span>"));
}

TEST_F(Report, WithoutOrientationNothingAnatomicalIsClaimed) {
  EXPECT_EQ(count(page(), "rientation unknown"), 0u);
  model.oriented = false;
  const std::string html = page();
  EXPECT_EQ(count(html, ">ORIENTATION UNKNOWN</text>"), 12u);
  EXPECT_EQ(count(html, "<span class=\"badge\">Orientation unknown</span>"), 1u);
  EXPECT_THAT(html, HasSubstr("do not state the orientation of the volume in the patient"));
  EXPECT_THAT(html, HasSubstr("<span class=\"badge side\">SIDE UNKNOWN</span>"));
  for (const std::string plane : {"Plane x-y", "Plane x-z", "Plane y-z"})
    EXPECT_EQ(count(html, "<figcaption><span>" + plane + "</span>"), 4u);
  for (const std::string claim :
       {"LEFT", "Axial", "Coronal", "Sagittal", "Radiological", "class=\"letter", "> S ", "> I ", "> P "})
    EXPECT_EQ(count(html, claim), 0u) << claim;
}

TEST_F(Report, StatesUnreachedTargets) {
  recording.summary->problems = {"line 9: asked for 2.00 N, felt 1.50 N on patella", "line 12: <no way>"};
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("Script steps that failed"));
  EXPECT_THAT(html,
              HasSubstr("<li>line 9: asked for 2.00 N, felt 1.50 N on patella</li>\n<li>line 12: &lt;no"));
  EXPECT_LT(html.find("Script steps that failed"), html.find("id=\"contacts-title\""));
  recording.summary->problems.clear();
  EXPECT_THAT(page(), Not(HasSubstr("steps that failed")));
}

TEST_F(Report, DepthOutOfRangeIsAGapWithANote) {
  EXPECT_THAT(page(), Not(HasSubstr("eeper than measured")));
  EXPECT_THAT(page(), Not(HasSubstr("no surface was within reach")));
  // the first contact, with the tibia, except for its beginning and end
  for (std::size_t i = 700; i < 1850; ++i)
    recording.ticks[i].device[0].depth_mm = std::numeric_limits<double>::quiet_NaN();
  const std::string html = page();
  // at the largest force, in the table and below it, and in the plot's description
  EXPECT_EQ(count(html, "eeper than measured"), 4u);
  EXPECT_THAT(html, HasSubstr("no surface was within reach"));
  const std::string depth = html.substr(html.find("\"depth\":[["));
  EXPECT_THAT(depth.substr(0, depth.find("]]")), HasSubstr("null,null,null,null,null,null,null,null,null"));
}

TEST_F(Report, DepthOutOfReachInFrontIsNotCalledDeep) {
  model.level_of_label.assign(example::kPatella + 1, 0.8F);
  for (TickRecord& tick : recording.ticks) {
    tick.device[0].depth_mm = std::numeric_limits<double>::quiet_NaN();
    tick.device[0].field = 0.1;
  }
  const std::string html = page();
  EXPECT_THAT(html, Not(HasSubstr("eeper than measured")));
  EXPECT_EQ(count(html, "<dt>Depth there</dt><dd>not measured</dd>"), 4u);
  EXPECT_THAT(html, HasSubstr("no surface was within reach"));
}

TEST_F(Report, DepthInFrontOfTheSurfaceIsExplained) {
  for (TickRecord& tick : recording.ticks) {
    if (tick.device[0].label == example::kPatella) tick.device[0].depth_mm = -0.63;
  }
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("-0.63 mm, 0.63 mm in front of the segmented surface"));
  EXPECT_THAT(html, HasSubstr("<td>-0.63<span class=\"note\">in front of the surface</span></td>"));
}

TEST_F(Report, TouchesInPassingAreCountedApart) {
  const auto tile = [this] {
    const std::string html = page();
    const auto at = html.find("<dt>Structures touched</dt>");
    return html.substr(at, html.find("</div>", at) - at);
  };
  EXPECT_THAT(tile(), HasSubstr("<dd>4</dd>"));
  EXPECT_THAT(tile(), Not(HasSubstr("in passing")));
  // the femur, for 100 ms after leaving the tibia
  for (std::size_t i = 2100; i < 2200; ++i) {
    recording.ticks[i].device[0].label = example::kFemur;
    recording.ticks[i].device[0].flags = kFlagContact;
  }
  EXPECT_THAT(tile(), HasSubstr("<dd>4</dd>"));
  EXPECT_THAT(tile(), HasSubstr("for 0.5 s or longer, 1 more in passing"));
}

TEST_F(Report, HasTheCaveatsOfTheModel) {
  EXPECT_EQ(count(page(), "Limitation of the model"), 0u);
  model.caveats = {{CaveatKind::kForce, "tissues of 0.5 to 0.6 N/mm are felt as one"},
                   {CaveatKind::kPlacement, "<b>"}};
  const std::string html = page();
  EXPECT_EQ(count(html, "Limitation of the model"), 2u);
  EXPECT_THAT(html, HasSubstr("tissues of 0.5 to 0.6 N/mm are felt as one."));
  EXPECT_THAT(html, HasSubstr("&lt;b&gt;"));
}

TEST_F(Report, ForceAboveTheLimitOfItsTickIsFlagged) {
  EXPECT_EQ(count(page(), "<p class=\"callout alert\""), 0u);
  recording.ticks[1500].device[0].force_N = {0, 0, 1.6};
  recording.ticks[1501].device[0].limit_N = 0.1;
  const std::string html = page();
  EXPECT_EQ(count(html, "<p class=\"callout alert\""), 1u);
  EXPECT_EQ(count(html, "<div class=\"tile alert\">"), 1u);
  EXPECT_THAT(html, HasSubstr("exceeded in 2 ticks"));
}

TEST_F(Report, OutsideIsNotAnIntervention) {
  for (TickRecord& tick : recording.ticks) tick.device[0].flags = kFlagOutside | kFlagPaused | kFlagClutched;
  *recording.summary = {};
  for (const TickRecord& tick : recording.ticks) recording.summary->observe(tick);
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("<dt>Safety interventions</dt><dd>0 "));
  const auto interventions = html.find(">Interventions</th>"),
             others = html.find(">Not an intervention</th>");
  ASSERT_NE(interventions, html.npos);
  ASSERT_NE(others, html.npos);
  for (const std::string row : {"Clamped", "Not finite", "Rotation ignored"}) {
    EXPECT_GT(html.find(">" + row + "</th>"), interventions);
    EXPECT_LT(html.find(">" + row + "</th>"), others);
  }
  for (const std::string row : {"Outside", "Paused", "Clutched"})
    EXPECT_GT(html.find(">" + row + "</th>"), others);
}

TEST_F(Report, EveryFlagThatWasMetHasARow) {
  const auto row = [](const std::string& name) { return "<th scope=\"row\">" + name + "</th>"; };
  const std::vector<std::pair<TickFlag, std::string>> rare{{kFlagThermal, "Thermal limit"},
                                                           {kFlagSlew, "Slewed"},
                                                           {kFlagStale, "Stale"},
                                                           {kFlagJump, "Jumped"},
                                                           {kFlagHalted, "Halted"},
                                                           {kFlagDeviceFault, "Device fault"},
                                                           {kFlagEmergencyStop, "Emergency stop"},
                                                           {kFlagClutched, "Clutched"}};
  const std::string without = page();
  for (const auto& [flag, name] : rare) EXPECT_THAT(without, Not(HasSubstr(row(name))));
  // 96 ticks with the first flag, 192 with the second, ...
  std::size_t ticks = 0;
  for (const auto& [flag, name] : rare) {
    ticks += 96;
    for (std::size_t i = 0; i < ticks; ++i) recording.ticks[i].device[0].flags |= flag;
  }
  recording.summary = RecordingSummary{};
  for (const TickRecord& tick : recording.ticks) recording.summary->observe(tick);
  const std::string html = page();
  for (std::size_t i = 0; i < rare.size(); ++i)
    EXPECT_THAT(html, HasSubstr(row(rare[i].second) + "<td>" + std::to_string(96 * (i + 1)) + "</td><td>" +
                                std::to_string(i + 1) + ".0 %</td>"));
  // a clutch is not an intervention
  EXPECT_THAT(html, HasSubstr(" invalid, 672 other<"));
}

TEST_F(Report, IdlePointerIsNoIntervention) {
  recording = example::real_recording(model);
  for (TickRecord& tick : recording.ticks) tick.device[0].flags = kFlagStale;
  recording.summary = RecordingSummary{};
  for (const TickRecord& tick : recording.ticks) recording.summary->observe(tick);
  const std::string ticks = std::to_string(recording.ticks.size());
  EXPECT_THAT(page(), HasSubstr(" invalid, " + ticks.substr(0, 1)));
  recording.header.device = "pointer";
  const std::string html = page();
  EXPECT_THAT(html, Not(HasSubstr("<th scope=\"row\">Stale</th>")));
  EXPECT_GT(html.find("<th scope=\"row\">Pointer at rest</th>"), html.find(">Not an intervention<"));
  EXPECT_THAT(html, HasSubstr("0 clamped, 0 invalid<"));
}

TEST_F(Report, StatesTheForceLimits) {
  recording.ticks[3000].device[0].heat = 0.93;
  recording.ticks[3001].device[0].limit_N = 1.45;
  const std::string html = page();
  for (const std::string text :
       {"<dt>Limit in effect</dt><dd>1.45 to 1.50 N</dd>", "<dt>The device gives at most</dt><dd>8.50 N</dd>",
        "<dt>The device: continuous force</dt><dd>1.40 N</dd>", "maximum used</dt><dd>93 %</dd>"})
    EXPECT_THAT(html, HasSubstr(text));
  for (TickRecord& tick : recording.ticks) tick.device[0].continuous_force_N = kNoValue;
  const std::string unknown = page();
  EXPECT_THAT(unknown, HasSubstr("<dt>The device: continuous force</dt><dd>not known</dd>"));
  EXPECT_THAT(unknown, HasSubstr("maximum used</dt><dd>none kept</dd>"));
}

TEST_F(Report, TheVirtualClockHasNoLoop) {
  const std::string html = page();
  EXPECT_THAT(html, Not(HasSubstr("loop-title")));
  EXPECT_THAT(html, Not(HasSubstr("\"lateness\":[")));
}

TEST_F(Report, TheRealClockShowsHowTheLoopKeptTime) {
  recording = example::real_recording(model);
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("<dt>Scheduler</dt><dd>SCHED_FIFO 80</dd>"));
  EXPECT_THAT(html, HasSubstr("<dt>Rate, measured</dt><dd>1000.0 Hz of 1000 Hz</dd>"));
  EXPECT_THAT(html, HasSubstr("<dt>Missed ticks</dt><dd>3 (0.031 %)</dd>"));
  EXPECT_THAT(html, HasSubstr("<dt>Ticks not recorded</dt><dd>0</dd>"));
  // the maximum is exact, and the plot preserves it
  EXPECT_THAT(html, HasSubstr("<td>3400.0</td><td class=\"text\">Delay of the start of a tick"));
  const std::string plotted = html.substr(html.find("\"lateness\":[["));
  EXPECT_THAT(plotted.substr(0, plotted.find("]]")), HasSubstr(",3400,"));
  for (const std::string name : {"Stale", "Halted", "Emergency stop"})
    EXPECT_THAT(html, HasSubstr("<th scope=\"row\">" + name + "</th>"));

  // a truncated recording lacks the skipped ticks but shows the gaps
  recording.summary.reset();
  for (std::size_t i = 5000; i < recording.ticks.size(); ++i) recording.ticks[i].tick += 96;
  const std::string cut = page();
  EXPECT_THAT(cut, HasSubstr("<dd>unknown: cut short</dd>"));
  EXPECT_THAT(cut, HasSubstr("<dt>Ticks not recorded</dt><dd>96 (0.990 %)</dd>"));
}

TEST_F(Report, StatesMissingTicks) {
  EXPECT_THAT(page(), Not(HasSubstr("Ticks are missing")));
  recording.summary->dropped = 12;
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("<strong>Ticks are missing.</strong> 12 ticks were computed but not recorded"));
  EXPECT_THAT(html, HasSubstr("so no replay can verify it"));
  EXPECT_THAT(html, Not(HasSubstr("recomputes the run and verifies it")));
}

TEST_F(Report, StatesThatTheHashIsTheRecordedOne) {
  EXPECT_THAT(page(), HasSubstr("<code>palpate replay</code> recomputes the run and verifies it"));
  recording.summary.reset();
  EXPECT_THAT(page(), Not(HasSubstr("recomputes the run")));
  // a truncated recording can be viewed like any other
  EXPECT_THAT(page(), HasSubstr("<code>palpate replay RECORDING --view</code>"));
}

TEST_F(Report, ARealDeviceIsNotCalledSimulated) {
  recording.header.simulated = false;
  recording.header.hand.clear();
  EXPECT_THAT(page(), Not(HasSubstr("imulated")));
}

TEST_F(Report, StatesATruncatedRecording) {
  recording.summary.reset();
  recording.ticks.resize(4000);
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("This recording was cut short"));
  EXPECT_EQ(count(html, "role=\"tab\""), 2u);
}

TEST_F(Report, AnEmptyOrUntouchedRunIsStillAPage) {
  recording.ticks.resize(300);  // before the first structure is reached
  EXPECT_THAT(page(), HasSubstr("No structure was touched"));
  recording.ticks.clear();
  EXPECT_THAT(page(), HasSubstr("The recording holds no tick"));
}

TEST_F(Report, DamagedNumbersDoNotReachThePage) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  recording = example::real_recording(model);
  recording.header.rate_hz = kNan;
  recording.header.devices = 99;
  for (std::size_t i = 700; i < recording.ticks.size(); i += 3) {
    TickRecord& tick = recording.ticks[i];
    tick.time_s = kNan;
    tick.max_force_N = -1e300;
    tick.lateness_s = i % 2 == 0 ? kNan : 1e300;
    tick.compute_s = -kNan;
    tick.tick = 0;
    tick.device[0].limit_N = kNan;
    tick.device[0].heat = kNan;
    tick.rotation_applied_wxyz = {0, 0, 0, 0};
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
  EXPECT_EQ(count(page(), "<figure class=\"volume\">"), 1u);
  EXPECT_EQ(count(page(), "<img class=\"near\""), count(page(), "role=\"tabpanel\""));
  model.labels.reset();
  EXPECT_EQ(count(page(), "<figure class=\"section\">"), 12u);
  EXPECT_EQ(count(page(), "<figure class=\"volume\">"), 0u);
}

TEST_F(Report, StatesTheRemovedVolume) {
  for (const std::string part : {"What was removed", "id=\"plot-removed\"", "Motor", "\"removed\":"})
    EXPECT_THAT(page(), Not(HasSubstr(part))) << "without a burr";
  model = example::with_burr(model);
  EXPECT_THAT(page(), Not(HasSubstr("What was removed"))) << "whose motor never ran";

  recording = example::milled_recording(model);
  const std::string html = page();
  EXPECT_EQ(count(html, "What was removed"), 1u);
  EXPECT_EQ(count(html, "id=\"plot-removed\""), 1u);
  EXPECT_THAT(html, HasSubstr("<dt>Motor switched on</dt><dd>2.00 s</dd>"));
  const std::string table = html.substr(html.find("What was removed"), 2000);
  EXPECT_THAT(table, ::testing::ContainsRegex("tibia</th><td>[0-9.]+</td><td>[0-9.]+</td><td>0.74</td>"));
  EXPECT_THAT(table, ::testing::ContainsRegex("patella</th><td>[0-9.]+</td><td>[0-9.]+</td><td>5.54</td>"));
  EXPECT_THAT(table, ::testing::ContainsRegex("All</th><td>[0-9.]+</td><td></td><td>0.74</td>"));
  EXPECT_THAT(html, HasSubstr("\"removed\":[[0,"));
  EXPECT_THAT(html, HasSubstr("\"removedOf\":[{\"colour\":\"#dc8c5a\",\"name\":\"tibia\"},"));

  // a motor run without any cut
  recording.events.clear();
  EXPECT_THAT(page(), HasSubstr("The burr removed nothing."));
  EXPECT_THAT(page(), Not(HasSubstr("id=\"plot-removed\"")));
}

// text between two strings, first occurrence after a position
std::string between(const std::string& text, const std::string& from, const std::string& to,
                    std::size_t after) {
  const std::size_t begin = text.find(from, after) + from.size();
  return text.substr(begin, text.find(to, begin) - begin);
}

TEST_F(Report, ShowsTissueWhereItHasYieldedTo) {
  model = example::with_soft_tibia(model);
  recording = example::leaning_recording(model);
  Model layers = model;
  layers.tissue_law = TissueLaw::kLayers;
  const std::string html = page(), still = report_html(recording, layers).value();
  // only the tibia is deformable: three sections with its strain, and the displaced tool
  EXPECT_EQ(count(html, "<img class=\"strain\""), 3u);
  EXPECT_EQ(count(html, "<circle class=\"tool\""), 3u);
  EXPECT_EQ(count(html, "id=\"strain\""), 1u);
  // a shaft is in two of the three planes and perpendicular to the other
  Model shaft = model;
  shaft.tools[0].capsules = {{{0, 0, 0}, {0, 0, 30}, 2}};
  const std::string with_shaft = report_html(recording, shaft).value();
  EXPECT_EQ(count(with_shaft, "<circle class=\"tool\""), 3u);
  EXPECT_EQ(count(with_shaft, "<polygon class=\"tool\""), 3u);
  EXPECT_EQ(count(html, "<p class=\"yielded\">"), 1u);
  EXPECT_THAT(html, ::testing::ContainsRegex("Equivalent strain in view: at most [0-9]+ %"));
  for (const std::string part : {"<img class=\"strain\"", "class=\"tool\"", "id=\"strain\"",
                                 "class=\"yielded\"", "layer-force", "\"layers\":", "surface at rest"})
    EXPECT_THAT(still.substr(0, still.find("<script>")), Not(HasSubstr(part))) << part;
  const auto scan_of = [](const std::string& of, const std::string& panel) {
    return between(of, "class=\"scan\"", ">", of.find("id=\"contact-" + panel + "\""));
  };
  EXPECT_NE(scan_of(html, "0"), scan_of(still, "0"));
  for (const std::string other : {"1", "2", "3"}) EXPECT_EQ(scan_of(html, other), scan_of(still, other));
  EXPECT_EQ(html, page());
  EXPECT_THAT(html, HasSubstr("by linear elasticity"));
  EXPECT_THAT(html, HasSubstr("solved on cells of"));
  EXPECT_THAT(still, Not(HasSubstr("solved on cells of")));
  Model mail = model;
  mail.tissue_law = TissueLaw::kChainMail;
  const std::string moved = report_html(recording, mail).value();
  EXPECT_EQ(count(moved, "<img class=\"strain\""), 3u);
  EXPECT_THAT(moved, HasSubstr("by the chain-mail model"));
  EXPECT_THAT(moved, Not(HasSubstr("linear elasticity")));
}

TEST_F(Report, WithLayersItIsAsIfNothingHadAModulus) {
  recording = example::leaning_recording(model);
  const std::string html = page();
  model.tissues[0].elastic = ElasticConstants{10, 0.45};
  EXPECT_EQ(page(), html);
}

TEST_F(Report, ListsTheForceShareOfEachStructure) {
  model = example::with_soft_tibia(model);
  recording = example::leaning_recording(model);
  const std::string html = page();
  EXPECT_THAT(html, HasSubstr("Depth below the surface at rest"));
  EXPECT_EQ(count(html, "id=\"plot-layer-force\""), 1u);
  EXPECT_EQ(count(html, "id=\"plot-layer-depth\""), 1u);
  EXPECT_THAT(html, HasSubstr("\"layers\":[{\"colour\":\"#dc8c5a\",\"name\":\"tibia\"},"));
  // three quarters of the tibia's maximum force; the femur contributes the rest
  double max_N = 0, deepest_mm = 0;
  for (const TickRecord& tick : recording.ticks) {
    const DeviceTick& device = tick.device[0];
    if (device.path_label[1] == 0) continue;
    max_N = std::max(max_N, device.contact_N[0]);
    deepest_mm = std::max(deepest_mm, device.depth_mm);
  }
  ASSERT_GT(max_N, 0.5);
  const auto max_of = [&](const std::string& plot, std::size_t series) {
    std::size_t at = html.find("\"" + plot + "\":[[");
    for (std::size_t n = 0; n < series; ++n) at = html.find("],[", at + 1);
    double largest = 0;
    const std::string values = between(html, "[", "]", series == 0 ? html.find("[[", at) + 1 : at + 1);
    for (std::size_t n = 0; n < values.size();
         n = values.find(',', n) == std::string::npos ? values.size() : values.find(',', n) + 1)
      if (values[n] != 'n') largest = std::max(largest, std::stod(values.substr(n)));
    return largest;
  };
  const std::size_t femur = 4;  // after the four touched structures
  EXPECT_NEAR(max_of("layerForce", femur), 0.25 * max_N, 0.002);
  EXPECT_NEAR(max_of("layerDepth", femur), deepest_mm - 0.3, 0.002);
  EXPECT_NEAR(max_of("layerDepth", 0), 0.3, 0.002);
}

TEST_F(Report, AnotherModelIsRefused) {
  recording.header.model_hash ^= 1;
  const auto html = report_html(recording, model);
  ASSERT_FALSE(html.ok());
  EXPECT_EQ(html.error().kind, ErrorKind::kBadInput);
  EXPECT_THAT(html.error().what, HasSubstr("a different model"));
  EXPECT_FALSE(html.error().remedy.empty());
}

TEST_F(Report, CanBeInterrupted) {
  const std::atomic<bool> stop = true;
  const auto html = report_html(recording, model, Progress({}, &stop));
  ASSERT_FALSE(html.ok());
  EXPECT_EQ(html.error().kind, ErrorKind::kInterrupted);
}

TEST_F(Report, MemoryIsIndependentOfRunLength) {
  const test::TemporaryFolder folder;
  // the example run repeated on one clock
  const auto peak_MiB = [&](int times) {
    auto writer = RecordingWriter::create(folder / "run.h5", recording.header);
    PALPATE_CHECK(writer.ok());
    std::uint64_t ticks = 0;
    for (int i = 0; i < times; ++i) {
      std::vector<TickRecord> again = recording.ticks;
      for (TickRecord& tick : again) {
        tick.tick = ticks++;
        tick.time_s = 1e-3 * static_cast<double>(tick.tick);
      }
      PALPATE_CHECK((*writer)->append(again).ok());
    }
    RecordingSummary summary;
    summary.ticks = ticks;
    PALPATE_CHECK((*writer)->finish(summary).ok());
    const double peak = test::peak_memory_of([&] {
      const auto source = RecordingSource::open(folder / "run.h5");
      const auto html = source ? report_html(*source, model) : source.error();
      return html && html->find("Contact per structure") != std::string::npos;
    });
    EXPECT_GT(peak, 0) << "there was no report";
    return peak;
  };
  const double once = peak_MiB(1), four_times = peak_MiB(4);
  const double more_MiB = 3.0 * static_cast<double>(recording.ticks.size() * sizeof(TickRecord)) / (1 << 20);
  EXPECT_LT(four_times - once, 0.25 * more_MiB)
      << once << " MiB and " << four_times << " MiB; the ticks themselves would be " << more_MiB << " more";
}

TEST_F(Report, IsWrittenAtomically) {
  const test::TemporaryFolder folder;
  ASSERT_TRUE(write_report(folder / "run.html", recording, model).ok());
  EXPECT_TRUE(test::bytes_of_file(folder / "run.html") == page());

  const auto failed = write_report(folder / "absent/run.html", recording, model);
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().kind, ErrorKind::kOutput);
  recording.header.model_hash ^= 1;
  EXPECT_FALSE(write_report(folder / "other.html", recording, model).ok());
  EXPECT_EQ(folder.count(), 1u);
}

}  // namespace
}  // namespace palpate::report
