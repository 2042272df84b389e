#include "rehearsal/trajectory_meter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "palpate/geometry/decompositions.h"

namespace palpate {
namespace {

constexpr double kClear_mm = 10;  // distance outside at which an insertion has ended
// maximum distance from the trajectory's axis at which depth is evaluated
constexpr double kBeside_mm = 20;
// minimum segment length; tremor at rest is smaller and not part of the path
constexpr double kMinPiece_mm = 0.05;
constexpr double kMinFitted_mm = 1;

double angle_between_deg(const Vector<Patient>& a, const Vector<Patient>& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

/// Interpolated point between two ticks.
RunPoint between(const RunPoint& from, const RunPoint& to, double part) {
  return {to.tick, from.time_s + part * (to.time_s - from.time_s), from.at + (to.at - from.at) * part};
}

/// Point of the segment between two ticks that is nearest to a given point.
RunPoint nearest_between(const RunPoint& from, const RunPoint& to, const Point<Patient>& position) {
  const Vector<Patient> displacement = to.at - from.at;
  const double squared = displacement.squared_norm();
  return between(from, to,
                 squared > 0 ? std::clamp((position - from.at).dot(displacement) / squared, 0.0, 1.0) : 1.0);
}

}  // namespace

void LineFit::add(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  const Eigen::Vector3d displacement = to - from;
  const double length = displacement.norm();
  length_mm_ += length;
  sum_ += 0.5 * length * (from + to);
  squares_ += length * (from * from.transpose() +
                        0.5 * (from * displacement.transpose() + displacement * from.transpose()) +
                        displacement * displacement.transpose() / 3);
}

LineFit::Line LineFit::line() const {
  const Eigen::Vector3d mean = sum_ / length_mm_;
  const Eigen::Matrix3d spread = squares_ / length_mm_ - mean * mean.transpose();
  const SymmetricEigen<3> axes = symmetric_eigen(spread);
  // eigenvalues are ascending; rounding may make small ones negative
  const Eigen::Vector3d variances = axes.values.cwiseMax(0);
  return {axes.vectors.col(2), std::sqrt(variances[0] + variances[1])};
}

TrajectoryMeter::TrajectoryMeter(const PlanTrajectory& planned, std::vector<bool> entry_structures,
                                 const std::vector<StructureDistance>& distances)
    : planned_(planned), axis_(planned.axis()), entry_structures_(std::move(entry_structures)) {
  for (const StructureDistance& distance : distances)
    if (distance.label() < entry_structures_.size() && entry_structures_[distance.label()])
      surfaces_.push_back(&distance);
}

// Distance outside the structures' surface, or outside the plane through the planned entry perpendicular to
// the trajectory. Far outside it may be any lower bound above the threshold.
double TrajectoryMeter::outside_mm(const MeterInput& now) {
  if (surfaces_.empty()) return -along_mm(now.point.at);
  if (evaluated_at_ && evaluated_outside_mm_ - (now.point.at - *evaluated_at_).norm() > 2 * kClear_mm)
    return evaluated_outside_mm_ - (now.point.at - *evaluated_at_).norm();
  evaluated_outside_mm_ = std::numeric_limits<double>::infinity();
  for (const StructureDistance* surface : surfaces_)
    evaluated_outside_mm_ = std::min(evaluated_outside_mm_, surface->distance_mm(now.point.at));
  evaluated_at_ = now.point.at;
  return evaluated_outside_mm_;
}

bool TrajectoryMeter::touches(const DeviceTick& device) const {
  const auto is_of_them = [&](LabelId label) {
    return label < entry_structures_.size() && entry_structures_[label];
  };
  if ((device.flags & kFlagContact) == 0) return false;
  return is_of_them(device.label) || std::ranges::any_of(device.contact_label, is_of_them);
}

void TrajectoryMeter::observe(const MeterInput& now) {
  const double outside = outside_mm(now);
  if (outside > kClear_mm)
    end_insertion();
  else
    find_entry(now, outside);
  if (current_.kind != EntryKind::kNone) extend_insertion(now);
  const RunPoint near = nearest_between(last_.value_or(now.point), now.point, planned_.target);
  if (const double mm = (near.at - planned_.target).norm(); mm < nearest_mm_) {
    nearest_mm_ = mm;
    nearest_ = near;
  }
  last_ = now.point;
  last_outside_mm_ = outside;
}

void TrajectoryMeter::find_entry(const MeterInput& now, double outside) {
  if (surfaces_.empty()) {
    const RunPoint near = nearest_between(last_.value_or(now.point), now.point, planned_.entry);
    const double mm = (near.at - planned_.entry).norm();
    if (mm >= nearest_entry_mm_) return;
    begin(EntryKind::kNearest, near);
    nearest_entry_mm_ = mm;
  } else if (current_.kind != EntryKind::kPassed && outside <= 0) {
    // near the surface the distance is interpolated linearly between ticks
    const bool came_from_outside = last_ && last_outside_mm_ > 0;
    begin(EntryKind::kPassed,
          came_from_outside ? between(*last_, now.point, last_outside_mm_ / (last_outside_mm_ - outside))
                            : now.point);
  } else if (current_.kind == EntryKind::kNone && touches(*now.device)) {
    begin(EntryKind::kTouched, now.point);
  }
}

void TrajectoryMeter::begin(EntryKind kind, const RunPoint& entry) {
  end_insertion();
  current_.kind = kind;
  current_.entry = entry;
  current_.fitted_to = entry.at;
}

void TrajectoryMeter::extend_insertion(const MeterInput& now) {
  const Point<Patient>& at = now.point.at;
  // in the first segment only the part after the entry
  const RunPoint& from = last_ && last_->time_s >= current_.entry.time_s ? *last_ : current_.entry;
  const RunPoint near = nearest_between(from, now.point, planned_.target);
  if (const double mm = (near.at - planned_.target).norm(); mm < current_.nearest_mm) {
    current_.nearest_mm = mm;
    current_.nearest = near;
  }
  if ((at - current_.fitted_to).norm() >= kMinPiece_mm) {
    current_.fit.add((current_.fitted_to - planned_.entry).eigen(), (at - planned_.entry).eigen());
    current_.fitted_to = at;
  }
  const double along = along_mm(at);
  const double beside = (at - planned_.entry - axis_ * along).norm();
  if (along <= current_.deepest_mm || beside > kBeside_mm) return;
  current_.deepest_mm = along;
  current_.deepest = now.point;
  current_.to_deepest = current_.fit;
  current_.shaft_deg = now.shaft ? angle_between_deg(-*now.shaft, axis_) : kNoValue;
}

void TrajectoryMeter::end_insertion() {
  if (current_.kind != EntryKind::kNone && current_.nearest_mm <= best_.nearest_mm) best_ = current_;
  current_ = Insertion();
  nearest_entry_mm_ = std::numeric_limits<double>::infinity();
}

TrajectoryResult TrajectoryMeter::finish(bool reports_orientation) {
  end_insertion();
  TrajectoryResult done;
  done.entry_error_mm.allowed = planned_.entry_within_mm;
  done.target_error_mm.allowed = planned_.target_within_mm;
  done.angle_deg.allowed = planned_.angle_within_deg;
  done.depth_error_mm.allowed = planned_.depth_within_mm;
  const bool entered = best_.kind != EntryKind::kNone;
  done.entry_kind = best_.kind;
  done.nearest = entered ? best_.nearest : nearest_;
  if (last_) {
    const Vector<Patient> off = done.nearest.at - planned_.target;
    done.target_error_mm.value = off.norm();
    done.along_mm = off.dot(axis_);
    done.lateral_mm = (off - axis_ * done.along_mm).norm();
  }
  if (!entered) return done;
  done.entry = best_.entry;
  done.entry_error_mm.value = (best_.entry.at - planned_.entry).norm();
  if (!std::isfinite(best_.deepest_mm)) return done;
  done.deepest = best_.deepest;
  done.depth_mm = (best_.deepest.at - best_.entry.at).dot(axis_);
  done.depth_error_mm.value = done.depth_mm - planned_.length_mm();
  if (reports_orientation) done.shaft_deg = best_.shaft_deg;
  const Vector<Patient> chord = best_.deepest.at - best_.entry.at;
  if (chord.norm() < kMinFitted_mm || best_.to_deepest.length_mm() < kMinFitted_mm) return done;
  const LineFit::Line line = best_.to_deepest.line();
  Vector<Patient> direction(line.direction);
  if (direction.dot(chord) < 0) direction = -direction;
  done.angle_deg.value = angle_between_deg(direction, axis_);
  done.line_rms_mm = line.rms_distance_mm;
  return done;
}

}  // namespace palpate
