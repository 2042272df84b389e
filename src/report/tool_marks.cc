#include "report/tool_marks.h"

namespace palpate::report {

Point<Patient> proxy_place(const TickRecord& tick, int device) {
  const auto& at = tick.device[static_cast<std::size_t>(device)].proxy_patient_mm;
  return {at[0], at[1], at[2]};
}

void add_tool(std::vector<VolumeMark>& marks, const Model& model, const TickRecord& tick, int device) {
  for (const ToolBall& ball : tool_balls(model, tick, device))
    marks.push_back({ball.middle, ball.middle, ball.radius_mm, ball.radius_mm, kToolColour, 0});
  const auto& w = tick.device[static_cast<std::size_t>(device)].orientation_wxyz;
  const Eigen::Quaterniond held(w[0], w[1], w[2], w[3]);
  if (!held.coeffs().allFinite() || !(held.squaredNorm() > 0)) return;
  for (const ToolCapsule& capsule : model.tool_of(static_cast<std::size_t>(device)).capsules) {
    const auto end = [&](const Eigen::Vector3d& at) {
      return proxy_place(tick, device) + in_patient(model, tick, Vector<World>(held.normalized() * at));
    };
    marks.push_back(
        {end(capsule.from_mm), end(capsule.to_mm), capsule.radius_mm, capsule.radius_mm, kToolColour, 0});
  }
}

}  // namespace palpate::report
