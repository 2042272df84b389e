#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/palpation/palpation.h"
#include "palpate/palpation/touch_site.h"
#include "palpation/default_script.h"
#include "palpation/force_sweep.h"
#include "palpation/script_text.h"

namespace palpate {
namespace {

// minimum force of a press step
constexpr double kMinPress_N = 0.05;
// force of a press, and its maximum as a fraction of the greatest force that the structure gives
constexpr double kPress_N = 1, kPressOfMost = 0.6;
// depth of a press, as a fraction of the structure's thickness there, and its bounds
constexpr double kPressOfThickness = 0.4, kShallowest_mm = 1.5, kDeepest_mm = 10;
// maximum number of structures examined for a free path to them
constexpr std::size_t kMaxExamined = 24;

bool has_every_structure(const Model& model, const Script& script) {
  return std::all_of(script.steps.begin(), script.steps.end(), [&](const ScriptStep& step) {
    const auto* approach = std::get_if<ApproachStep>(&step);
    if (!approach) return true;
    const Segment* segment = model.find(approach->structure);
    return segment != nullptr && model.is_touchable(segment->id);
  });
}

// the touchable structures by their number of voxels, largest first
std::vector<LabelId> largest_touchable(const Model& model) {
  const std::vector<std::size_t> voxels = label_counts(*model.labels);
  std::vector<LabelId> labels;
  for (const Segment& segment : model.segments)
    if (model.is_touchable(segment.id) && voxels[segment.id] > 0) labels.push_back(segment.id);
  std::stable_sort(labels.begin(), labels.end(), [&](LabelId a, LabelId b) { return voxels[a] > voxels[b]; });
  return labels;
}

// length of the inward line from the surface on that lies within the structure
double thickness_mm(const Model& model, LabelId structure, const Point<Patient>& surface,
                    const Vector<Patient>& inward) {
  constexpr double kMax_mm = 100;
  const double step_mm = 0.5 * model.labels->geometry().min_spacing_mm();
  const auto is_within = [&](double distance_mm) {
    const Point<Voxel> p = model.labels->X_VoxelPatient() * (surface + inward * distance_mm);
    const auto index = [&](int axis) { return static_cast<int>(std::floor(p[axis] + 0.5)); };
    return model.labels->anywhere(index(0), index(1), index(2)) == structure;
  };
  // the surface lies up to a voxel in front of the first voxel's centre
  double distance_mm = 2 * step_mm;
  while (distance_mm < kMax_mm && is_within(distance_mm)) distance_mm += step_mm;
  return distance_mm;
}

// greatest force of a descent at a place, and the depth at which it ends
struct ReachedForce {
  double force_N = 0, depth_mm = 0;
};

ReachedForce force_reached(const Model& model, const Parameters& parameters, double rate_hz,
                           LabelId structure, const TouchSite& site) {
  const Vector<Patient> inward = -site.from;
  const double max_mm =
      std::clamp(kPressOfThickness * thickness_mm(model, structure, site.surface.point, inward),
                 kShallowest_mm, kDeepest_mm);
  ReachedForce reached;
  for (const SweptForce& swept : sweep_force(model, parameters, site.in_front, inward, max_mm, rate_hz)) {
    if (swept.label != structure) break;
    reached.force_N = std::max(reached.force_N, swept.force_N);
    reached.depth_mm = swept.depth_mm;
    if (kPressOfMost * reached.force_N >= kPress_N) break;
  }
  return reached;
}

// "a descent of 3.2 mm gives 0.70 N (proxy)"
std::string reached_text(const ReachedForce& reached, const Parameters& parameters) {
  char text[80];
  std::snprintf(text, sizeof text, "a descent of %.1f mm gives %.2f N (", reached.depth_mm, reached.force_N);
  return text + std::string(name_of(parameters.method)) + ")";
}

}  // namespace

std::optional<Script> knee_script(const Model& model) {
  const auto text = embedded_script("knee");
  PALPATE_CHECK(text.has_value());
  auto knee = parse_script(*text, "embedded knee script");
  PALPATE_CHECK(knee.ok());
  if (!has_every_structure(model, *knee)) return std::nullopt;
  return *std::move(knee);
}

Result<void> plan_default_script(const Model& model, const Parameters& parameters, Script& script) {
  script.title = "largest structures";
  script.source = "default script";
  const FreeSpace free_space(model, tool_reach_mm(model.tool_of(0)));
  const auto add = [&](ScriptStep step) { script.steps.push_back(std::move(step)); };
  std::size_t palpated = 0, examined = 0;
  for (const LabelId label : largest_touchable(model)) {
    if (palpated == kMaxPalpated || examined++ == kMaxExamined) break;
    ApproachStep approach;
    approach.structure = "#" + std::to_string(label);
    TouchRequest request;
    request.clearance_mm = approach.clearance_mm;
    const TouchSites sites = find_touch_sites(model, free_space, label, request);
    if (sites.sites.empty()) {
      script.limitations.push_back(model.name_of(label) + " is not palpated: " + sites.why_none);
      continue;
    }
    // the simulated hand uses the first place at which it meets the surface
    ReachedForce reached;
    for (const TouchSite& site : sites.sites) {
      reached = force_reached(model, parameters, script.rate_hz, label, site);
      if (reached.force_N > 0) break;
    }
    if (reached.force_N == 0) {
      script.limitations.push_back(model.name_of(label) +
                                   " is not palpated: " + reached_text(reached, parameters));
      continue;
    }
    ++palpated;
    const double press_N = std::clamp(kPressOfMost * reached.force_N, kMinPress_N, kPress_N);
    if (press_N < kPress_N) {
      char text[60];
      std::snprintf(text, sizeof text, " is pressed with %.2f N: ", press_N);
      script.limitations.push_back(model.name_of(label) + text + reached_text(reached, parameters));
    }
    add(approach);
    add(PressStep{.force_N = press_N});
    add(HoldStep{.seconds = 0.7});
    add(LeaveStep{});
  }
  if (palpated > 0) {
    // step lines refer to the text that a recording stores
    const auto text = parse_script(script_text(script), script.source);
    PALPATE_CHECK(text.ok());
    script.lines = text->lines;
    return {};
  }
  std::string why;
  for (std::size_t n = 0; n < std::min<std::size_t>(3, script.limitations.size()); ++n)
    why += (n == 0 ? ": " : "; ") + script.limitations[n];
  return Error{ErrorKind::kBadInput, "the tool cannot reach any touchable structure" + why, model.title,
               "set touchable = false on the structures that cover them, or write a script (--script)"};
}

}  // namespace palpate
