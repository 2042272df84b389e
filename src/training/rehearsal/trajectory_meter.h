#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "rehearsal/meter_input.h"

namespace palpate {

/// Line of best fit to a path, from moments of its segments: total least squares, with segments weighted by
/// length, solved by the eigenvectors of the covariance (Pearson, "On lines and planes of closest fit",
/// 1901).
class LineFit {
 public:
  /// Adds a straight segment; both ends relative to a fixed origin near the path, mm.
  void add(const Eigen::Vector3d& from, const Eigen::Vector3d& to);
  double length_mm() const { return length_mm_; }
  struct Line {
    Eigen::Vector3d direction;  ///< Direction; unit
    double rms_distance_mm;     ///< RMS distance of the path from the line
  };
  /// Requires length_mm() > 0.
  Line line() const;

 private:
  double length_mm_ = 0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares_ = Eigen::Matrix3d::Zero();
};

/// Measures the execution of one trajectory (TrajectoryResult).
class TrajectoryMeter {
 public:
  /// @param entry_structures  structures by LabelId; empty: the entry is a free point
  /// @param distances         have to outlive this object
  TrajectoryMeter(const PlanTrajectory& planned, std::vector<bool> entry_structures,
                  const std::vector<StructureDistance>& distances);

  void observe(const MeterInput& now);
  /// @param reports_orientation  whether the device reports an orientation
  TrajectoryResult finish(bool reports_orientation);

 private:
  // one insertion, from its entry on
  struct Insertion {
    EntryKind kind = EntryKind::kNone;
    RunPoint entry, nearest, deepest;
    double nearest_mm = std::numeric_limits<double>::infinity();
    // along the trajectory, from the planned entry
    double deepest_mm = -std::numeric_limits<double>::infinity();
    double shaft_deg = kNoValue;  // at the deepest point
    LineFit fit, to_deepest;
    Point<Patient> fitted_to;
  };
  double outside_mm(const MeterInput& now);
  bool touches(const DeviceTick& device) const;
  void find_entry(const MeterInput& now, double outside_mm);
  void begin(EntryKind kind, const RunPoint& entry);
  void extend_insertion(const MeterInput& now);
  void end_insertion();
  double along_mm(const Point<Patient>& at) const { return (at - planned_.entry).dot(axis_); }

  PlanTrajectory planned_;
  Vector<Patient> axis_;
  std::vector<bool> entry_structures_;
  std::vector<const StructureDistance*> surfaces_;
  Insertion current_, best_;
  // without structures: of the current insertion
  double nearest_entry_mm_ = std::numeric_limits<double>::infinity();
  // without any insertion: closest approach of the run to the target
  RunPoint nearest_;
  double nearest_mm_ = std::numeric_limits<double>::infinity();
  std::optional<RunPoint> last_;
  double last_outside_mm_ = 0;
  // last evaluated distance outside, and its point
  std::optional<Point<Patient>> evaluated_at_;
  double evaluated_outside_mm_ = 0;
};

}  // namespace palpate
