#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "rehearsal/seen_tick.h"

namespace palpate {

/// The line that fits a way best, from sums over its pieces: least squares of the distances from the line,
/// each piece by its length, solved by the covariance's eigenvectors (Pearson, "On lines and planes of
/// closest fit", 1901).
class LineFit {
 public:
  /// A straight piece; places from one origin that lies near them, mm.
  void add(const Eigen::Vector3d& from, const Eigen::Vector3d& to);
  double length_mm() const { return length_mm_; }
  struct Line {
    Eigen::Vector3d direction;  ///< unit
    double off_mm;              ///< root of the mean square of the distances from it
  };
  /// Of a way that is longer than 0.
  Line line() const;

 private:
  double length_mm_ = 0;
  Eigen::Vector3d sum_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares_ = Eigen::Matrix3d::Zero();
};

/// What was made of one trajectory (TrajectoryDone).
class TrajectoryMeter {
 public:
  /// @param enters  by LabelId; empty: the entry is a place alone  @param distances  outlive it
  TrajectoryMeter(const PlanTrajectory& planned, std::vector<bool> enters,
                  const std::vector<StructureDistance>& distances);

  void see(const SeenTick& now);
  /// @param tells_turn  the device told how the tool was turned
  TrajectoryDone finish(bool tells_turn);

 private:
  // from an entry on
  struct Way {
    EntryMade made = EntryMade::kNone;
    PlaceInRun entry, nearest, deepest;
    double nearest_mm = std::numeric_limits<double>::infinity();
    double deepest_mm = -std::numeric_limits<double>::infinity();  // along the trajectory from its entry
    double shaft_deg = kNotKnown;                                  // at the deepest place
    LineFit fit, to_deepest;
    Point<Patient> fitted_to;
  };
  double outside_mm(const SeenTick& now);
  bool touches(const DeviceTick& device) const;
  void look_for_entry(const SeenTick& now, double outside_mm);
  void begin(EntryMade made, const PlaceInRun& entry);
  void go_on(const SeenTick& now);
  void end_way();
  double along_mm(const Point<Patient>& at) const { return (at - planned_.entry).dot(axis_); }

  PlanTrajectory planned_;
  Vector<Patient> axis_;
  std::vector<bool> enters_;
  std::vector<const StructureDistance*> surfaces_;
  Way way_, best_;
  double nearest_entry_mm_ = std::numeric_limits<double>::infinity();  // of this way, without structures
  // where no way was made, how near the run came to the target
  PlaceInRun nearest_;
  double nearest_mm_ = std::numeric_limits<double>::infinity();
  std::optional<PlaceInRun> last_;
  double last_outside_mm_ = 0;
  // known distance outside, at a place
  std::optional<Point<Patient>> known_at_;
  double known_mm_ = 0;
};

}  // namespace palpate
