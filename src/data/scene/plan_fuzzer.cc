#include <cmath>
#include <cstdint>

#include "palpate/scene/plan_file.h"

// any input gives a plan that survives a round trip through plan_text, or one error with its line
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto plan = palpate::parse_plan({reinterpret_cast<const char*>(data), size}, "plan.toml");
  if (!plan) {
    PALPATE_CHECK(!plan.error().what.empty() && plan.error().where.starts_with("plan.toml"));
    return 0;
  }
  for (const auto& trajectory : plan->trajectories)
    PALPATE_CHECK(trajectory.length_mm() >= palpate::kMinTrajectory_mm &&
                  trajectory.length_mm() <= palpate::kMaxTrajectory_mm);
  for (const auto& region : plan->regions) {
    const bool is_shape = region.shape != palpate::PlanShape::kStructures;
    PALPATE_CHECK(is_shape ? region.trajectory < plan->trajectories.size() : !region.structures.empty());
    PALPATE_CHECK(region.shape != palpate::PlanShape::kBox || std::abs(region.across.norm() - 1) < 1e-9);
  }
  const std::string text = palpate::plan_text(*plan);
  const auto again = palpate::parse_plan(text, "plan.toml");
  PALPATE_CHECK(again.ok() && palpate::plan_text(*again) == text);
  return 0;
}
