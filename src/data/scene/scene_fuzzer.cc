#include <cmath>
#include <cstdint>

#include "palpate/scene/scene.h"

// any input gives a scene with all values in range, or one error with its line
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto scene = palpate::parse_scene({reinterpret_cast<const char*>(data), size}, "scene.toml");
  if (!scene) {
    PALPATE_CHECK(!scene.error().what.empty() && scene.error().where.starts_with("scene.toml"));
    return 0;
  }
  PALPATE_CHECK(!scene->tissues.empty() && scene->tissues.size() <= palpate::kMaxTissues);
  PALPATE_CHECK(!scene->tools.empty() && scene->tools.size() <= 2);
  for (const auto& tool : scene->tools)
    PALPATE_CHECK(!tool.points_mm.empty() &&
                  tool.points_mm.size() + tool.capsules.size() <= palpate::kMaxToolParts);
  const auto& workspace = scene->workspace;
  PALPATE_CHECK(workspace.scale >= palpate::kMinScale && workspace.scale <= palpate::kMaxScale);
  PALPATE_CHECK(workspace.force_gain >= palpate::kMinScale && workspace.force_gain <= palpate::kMaxScale);
  PALPATE_CHECK(workspace.clutch_button >= -1 && workspace.clutch_button < 32);
  PALPATE_CHECK(!workspace.home || workspace.home->all_finite());
  for (const auto& tissue : scene->tissues) {
    PALPATE_CHECK(tissue.labels.empty() == (tissue.threshold.has_value() || tissue.embedding));
    PALPATE_CHECK(tissue.stiffness_N_per_mm >= 0.001 && tissue.stiffness_N_per_mm <= 20);
    PALPATE_CHECK(std::isfinite(tissue.opacity));
  }
  palpate::LabelMap labels;
  labels.segments.push_back({1, "femur", {}, 0, 1});
  labels.segments.push_back({2, "", {}, 0, 2});
  (void)palpate::resolve_labels(*scene, labels).ok();
  return 0;
}
