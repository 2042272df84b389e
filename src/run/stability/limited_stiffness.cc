#include "palpate/stability/limited_stiffness.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/device/rendered_stiffness.h"
#include "palpate/servo/servo.h"
#include "palpate/stability/critical_stiffness.h"

namespace palpate {
namespace {

// A device behind skin has the least damping: its own and the skin's. Theory neglects friction, which
// stabilises, and encoder steps, which the margin covers (critical_stiffness_test).
double theoretical_limit(const PlantDevice& device, double rate_hz, double delay_s) {
  double damping_N_s_per_m = find_plant_hand("light-grip")->damping_N_s_per_m;
  for (const PlantHand& hand : plant_hands_with_skin())
    damping_N_s_per_m = std::min(damping_N_s_per_m, hand.skin_N_s_per_m);
  damping_N_s_per_m += device.damping_N_s_per_m;
  return kStiffnessMargin * theoretical_stiffness_N_per_mm(damping_N_s_per_m, rate_hz, delay_s);
}

const Tissue& stiffest_of(const Model& model) {
  return *std::max_element(model.tissues.begin(), model.tissues.end(), [](const Tissue& a, const Tissue& b) {
    return (a.touchable ? a.stiffness_N_per_mm : 0) < (b.touchable ? b.stiffness_N_per_mm : 0);
  });
}

std::string loop_text(double rate_hz, double delay_s) {
  char loop[80];
  std::snprintf(loop, sizeof loop, delay_s > 0 ? " at %g Hz with %g ms of delay" : " at %g Hz", rate_hz,
                delay_s * 1e3);
  return loop;
}

std::string stability_text(const PlantDevice& device, double rate_hz, double delay_s) {
  char margin[120];
  std::snprintf(margin, sizeof margin,
                ", %.1f of the stiffness at which a grip starts to oscillate (passive with any hand: %.3g)",
                kStiffnessMargin, passivity_bound_N_per_mm(device, rate_hz));
  return "is stable with " + device.name + loop_text(rate_hz, delay_s) + margin;
}

}  // namespace

Result<LimitedStiffness> limited_stiffness(const Model& model, const WorkspaceSettings& workspace,
                                           ForceMethod method, const PlantDevice& device, double rate_hz,
                                           double delay_s, const Progress& progress) {
  const Tissue& stiffest = stiffest_of(model);
  const double one_point = RenderedStiffness(workspace).at_device(stiffest.stiffness_N_per_mm);
  const double all_points = one_point * static_cast<double>(model.tool_of(0).points_mm.size());
  LimitedStiffness limited;
  limited.requested_N_per_mm = method == ForceMethod::kProxy ? one_point : all_points;
  const double vendor_limit_N_per_mm = stiffness_bound_N_per_mm(SimulatedDevice(device, PlantHand{}).info());
  double stable_limit_N_per_mm = theoretical_limit(device, rate_hz, delay_s);
  // beyond the vendor's specification no stability is needed
  if (std::min(all_points, vendor_limit_N_per_mm) > stable_limit_N_per_mm) {
    progress.report("stable stiffness of the device", 0);
    const auto most = recommended_stiffness_N_per_mm(device, rate_hz, delay_s, progress);
    if (!most) return most.error();
    progress.report("stable stiffness of the device", 1);
    stable_limit_N_per_mm = *most;
  }
  limited.max_N_per_mm = std::min(stable_limit_N_per_mm, vendor_limit_N_per_mm);
  if (limited.requested_N_per_mm <= limited.max_N_per_mm) return limited;

  const auto points = static_cast<int>(std::lround(limited.requested_N_per_mm / one_point));
  char text[400];
  std::snprintf(
      text, sizeof text,
      "'%s' asks for %.3g N/mm (stiffness %.3g x scale %.3g x force gain %.3g, %d point%s): "
      "limited to %.3g, the maximum that %s",
      stiffest.name.c_str(), limited.requested_N_per_mm, stiffest.stiffness_N_per_mm, workspace.scale,
      workspace.force_gain, points, points == 1 ? "" : "s", limited.max_N_per_mm,
      (vendor_limit_N_per_mm < stable_limit_N_per_mm ? "the vendor of " + device.name + " guarantees"
                                                     : stability_text(device, rate_hz, delay_s))
          .c_str());
  limited.clamped = text;
  return limited;
}

LimitedDamping limited_damping(const Model& model, const WorkspaceSettings& workspace,
                               const PlantDevice& device, double rate_hz, double delay_s) {
  LimitedDamping limited;
  limited.max_N_s_per_mm = recommended_damping_N_s_per_mm(device, rate_hz, delay_s);
  std::string source = "the proxy's coupling";
  double requested_N_s_per_mm = model.method_settings.coupling_damping_N_s_per_mm;
  for (const Tissue& tissue : model.tissues)
    if (tissue.touchable && tissue.viscosity_N_s_per_mm > requested_N_s_per_mm) {
      source = "'" + tissue.name + "'";
      requested_N_s_per_mm = tissue.viscosity_N_s_per_mm;
    }
  const double rendered_N_s_per_mm = RenderedStiffness(workspace).at_device(requested_N_s_per_mm);
  if (rendered_N_s_per_mm <= limited.max_N_s_per_mm) return limited;

  char text[400];
  std::snprintf(text, sizeof text,
                "%s asks for %.3g N s/mm of damping (%.3g x scale %.3g x force gain %.3g): limited to %.2g, "
                "the maximum for %s%s, %.1f of the damping at which it starts to oscillate by itself",
                source.c_str(), rendered_N_s_per_mm, requested_N_s_per_mm, workspace.scale,
                workspace.force_gain, limited.max_N_s_per_mm, device.name.c_str(),
                loop_text(rate_hz, delay_s).c_str(), kStiffnessMargin);
  limited.clamped = text;
  return limited;
}

}  // namespace palpate
