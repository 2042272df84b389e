#include "report/tool_marks.h"

namespace palpate::report {

Point<Patient> proxy_position(const TickRecord& tick, int device) {
  const auto& at = tick.device[static_cast<std::size_t>(device)].proxy_patient_mm;
  return {at[0], at[1], at[2]};
}

void add_tool(std::vector<VolumeMark>& marks, const Model& model, const TickRecord& tick, int device) {
  for (const OverlayPart& part : overlay_parts(model, tick, device))
    marks.push_back({part.from, part.from + part.along_mm, part.radius_mm,
                     part.radius_mm + part.radius_change_mm, kToolColour, 0});
}

}  // namespace palpate::report
