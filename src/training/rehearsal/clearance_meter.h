#pragma once

#include <optional>
#include <vector>

#include "rehearsal/meter_input.h"

namespace palpate {

/// Measures the clearance between a tool's head and each structure.
class ClearanceMeter {
 public:
  /// @param distances     have to outlive this object
  /// @param requested_mm  required clearance by label
  /// @param intervals     number of intervals of the time series
  ClearanceMeter(const std::vector<StructureDistance>& distances,
                 const std::map<LabelId, double>& requested_mm, std::size_t intervals);

  void observe(const MeterInput& now);
  void finish(PlanComparison& to);

 private:
  struct Structure {
    const StructureDistance* distance;
    StructureClearance approach;
    std::optional<ClearanceViolation> violation;  // in progress
    // state of the last evaluated tick
    bool known = false;
    ToolHead head;
    double gap_mm = 0;
  };
  void observe(const MeterInput& now, Structure& structure);
  void follow_violation(const MeterInput& now, double gap_mm, Structure& structure);
  void end_violation(Structure& structure);

  std::vector<Structure> structures_;
  std::vector<ClearanceViolation> violations_;
  std::uint64_t omitted_violations_ = 0;
};

}  // namespace palpate
