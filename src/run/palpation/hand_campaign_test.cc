// Generated patients, each with an anomaly, palpated by the default script of each: every step holds or fails
// with its name, and the tip is never deeper than its force explains. PALPATE_TEST_PATIENTS=all runs all of
// them and prints the table of docs/guide/script.md; by default two coarse ones represent them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "base/test_files.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/palpation/run_setup.h"

namespace palpate {
namespace {

constexpr double kMaxBeyond_mm = 1;

const std::vector<std::string>& patients() {
  static const std::vector<std::string> all{
      "knee-phantom:side=right,seed=1",
      "knee-phantom:size=0.6,seed=2",
      "knee-phantom:lesion=6,seed=3",
      "knee-phantom:missing=femoral_cartilage+medial_meniscus,seed=4",
      "knee-phantom:noise=0.4,islands=40,seed=5",
      "knee-phantom:spacing=0.5x0.5x2,seed=6",
      "knee-phantom:lesion=3,lesion-in=patellar_cartilage,lesion-depth=1,size=1.15,seed=7",
      "knee-phantom:defect=6,noise=0.3,side=right,seed=8",
      "shell-phantom:thickness=1.5",
      "skull-phantom:temporal=1.8",
      "gland-phantom:fat=3,skin=1.5",
  };
  static const std::vector<std::string> some{"knee-phantom:lesion=6,seed=3,spacing=1.5",
                                             "gland-phantom:spacing=1.5"};
  const char* which = std::getenv("PALPATE_TEST_PATIENTS");
  return which && std::string_view(which) == "all" ? all : some;
}

struct Block {
  int line = 0;  // line of its approach
  std::string structure;
  std::vector<int> lines;  // lines of all its steps
  double force_N = 0, hold_s = 0;
};

std::vector<Block> blocks_of(const Script& script) {
  std::vector<Block> blocks;
  for (std::size_t s = 0; s < script.steps.size(); ++s) {
    if (const auto* approach = std::get_if<ApproachStep>(&script.steps[s]))
      blocks.push_back({script.lines[s], approach->structure, {}, 0, 0});
    blocks.back().lines.push_back(script.lines[s]);
    if (const auto* press = std::get_if<PressStep>(&script.steps[s])) blocks.back().force_N = press->force_N;
    if (const auto* hold = std::get_if<HoldStep>(&script.steps[s])) blocks.back().hold_s = hold->seconds;
  }
  return blocks;
}

// maximum excess of the tip's depth over force divided by stiffness plus a millimetre, by the tick's depth
// and by the surfaces; negative: none
double max_beyond_mm(const Recording& recording, const Model& model, double force_N) {
  double largest = -1e9;
  for (const TickRecord& t : recording.ticks) {
    const DeviceTick& d = t.device[0];
    const Point<Patient> tip(d.tip_patient_mm[0], d.tip_patient_mm[1], d.tip_patient_mm[2]);
    const auto explained_mm = [&](double stiffness) {
      return force_N / std::min(stiffness, d.max_stiffness_N_per_mm) + kMaxBeyond_mm;
    };
    if (d.label != 0)
      largest = std::max(largest, d.depth_mm - explained_mm(model.tissue_of(d.label)->stiffness_N_per_mm));
    for (const ContactSurface& s : model.surfaces) {
      if (s.surface == nullptr) continue;
      // an outer surface renders the stiffness of the structure in contact
      const double stiffness = s.owners != nullptr && d.label != 0
                                   ? model.tissue_of(d.label)->stiffness_N_per_mm
                                   : s.stiffness_N_per_mm;
      largest = std::max(largest, -s.surface->distance_mm(tip) - explained_mm(stiffness));
    }
  }
  return largest;
}

class HandCampaign : public ::testing::TestWithParam<std::string> {};

TEST_P(HandCampaign, EveryStepHoldsOrFailsByName) {
  auto loaded = load_scene_or_data_set({GetParam()});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message();
  const ForceMethod proxy[] = {ForceMethod::kProxy};
  auto ready = prepared_with_cache(loaded->model, proxy);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  loaded->model = *ready;
  const Model& model = *loaded->model;
  const auto setup = set_up_run(*loaded, {}, {}, {});
  ASSERT_TRUE(setup.ok()) << setup.error().message();
  const Script& script = setup->script;

  test::TemporaryFolder folder;
  const auto result = simulate(*loaded, script, {}, folder / "run.h5");
  ASSERT_TRUE(result.ok()) << result.error().message();
  const auto recording = read_recording(folder / "run.h5");
  ASSERT_TRUE(recording.ok()) << recording.error().message();

  // each approach with its following steps
  std::size_t held = 0;
  double max_requested_N = 0;
  std::string failed;
  const std::vector<Block> blocks = blocks_of(script);
  ASSERT_FALSE(blocks.empty());
  for (const Block& block : blocks) {
    max_requested_N = std::max(max_requested_N, block.force_N);
    const auto touched = std::find_if(result->touches.begin(), result->touches.end(),
                                      [&](const TouchFigure& t) { return t.line == block.line; });
    const bool named =
        std::any_of(result->problems.begin(), result->problems.end(), [&](const auto& sentence) {
          return std::any_of(block.lines.begin(), block.lines.end(), [&](int line) {
            return sentence.starts_with("script line " + std::to_string(line) + ": ") &&
                   sentence.find(" failed: ") != std::string::npos;
          });
        });
    if (named) {
      failed += (failed.empty() ? "" : ", ") + block.structure;
      continue;
    }
    ++held;
    ASSERT_NE(touched, result->touches.end()) << block.structure << " was not touched, and nothing says so";
    const auto hold = std::find_if(result->holds.begin(), result->holds.end(),
                                   [&](const HoldFigure& h) { return h.label == touched->label; });
    ASSERT_NE(hold, result->holds.end());
    EXPECT_GE(hold->held_s, block.hold_s - 1e-3) << hold->structure;
  }
  EXPECT_EQ(result->failed_steps == 0, failed.empty());
  EXPECT_GT(held, 0u);

  const double beyond_mm = max_beyond_mm(*recording, model, max_requested_N);
  EXPECT_LE(beyond_mm, 0);
  std::printf("| `%s` | %zu | %zu | %s | %.2f |\n", GetParam().c_str(), blocks.size(), held,
              failed.empty() ? "—" : failed.c_str(), kMaxBeyond_mm + beyond_mm);
  for (const std::string& sentence : result->problems) std::printf("    %s\n", sentence.c_str());
}

INSTANTIATE_TEST_SUITE_P(Patients, HandCampaign, ::testing::ValuesIn(patients()), [](const auto& patient) {
  std::string name = patient.param;
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return name;
});

}  // namespace
}  // namespace palpate
