#include "haptics/capsule_row.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

Point<Patient> place_of_step(const Point<Patient>& centre, const Vector<Patient>& along_mm, int steps,
                             int step) {
  return centre + along_mm * (static_cast<double>(step) / steps);
}

class RowSearch {
 public:
  RowSearch(const Surface& surface, const Point<Patient>& centre, const Vector<Patient>& along_mm, int steps,
            double enough_mm)
      : surface_(surface), centre_(centre), along_mm_(along_mm), steps_(steps), enough_mm_(enough_mm) {}

  double look(int step) {
    ++looks_;
    const double distance_mm = surface_.distance_mm(place_of_step(centre_, along_mm_, steps_, step));
    if (distance_mm < nearest_.distance_mm) nearest_ = {distance_mm, step};
    return distance_mm;
  }

  // all steps from one to another; of what need not be looked at a bound is kept
  void search(int first, int last) {
    if (first > last) return;
    const int middle = (first + last) / 2;
    const double distance_mm = look(middle), rise_mm = surface_.steepest() * along_mm_.norm() / steps_;
    const double least_mm = distance_mm - rise_mm * (last - middle);
    if (least_mm > std::min(enough_mm_, nearest_.distance_mm)) {
      if (last > first) left_out_mm_ = std::min(left_out_mm_, least_mm);
      return;
    }
    search(first, middle - 1);
    search(middle + 1, last);
  }

  NearestInRow nearest() const {
    if (nearest_.distance_mm <= enough_mm_) return nearest_;
    return {std::min(nearest_.distance_mm, left_out_mm_), nearest_.step};
  }
  int looks() const { return looks_; }

 private:
  const Surface& surface_;
  const Point<Patient>& centre_;
  const Vector<Patient>& along_mm_;
  const int steps_;
  const double enough_mm_;
  NearestInRow nearest_{std::numeric_limits<double>::infinity(), 0};
  double left_out_mm_ = std::numeric_limits<double>::infinity();
  int looks_ = 0;
};

}  // namespace

int row_steps(const ToolSphere& sphere) {
  if (sphere.along_mm == Vector<Patient>()) return 0;
  // the outline of two spheres dips by r - sqrt(r^2 - (pitch / 2)^2), which is below pitch^2 / 8 r * 1.04
  // here
  const double pitch_mm = std::max(kLeastPitch_mm, std::sqrt(7.5 * sphere.radius_mm * kRowDip_mm));
  return static_cast<int>(std::ceil(sphere.along_mm.norm() / pitch_mm));
}

NearestInRow nearest_in_row(const Surface& surface, const Point<Patient>& centre,
                            const Vector<Patient>& along_mm, int steps, int begin, double enough_mm,
                            int& looks) {
  RowSearch row(surface, centre, along_mm, steps, enough_mm);
  row.look(begin);
  row.search(0, begin - 1);
  row.search(begin + 1, steps);
  looks += row.looks();
  return row.nearest();
}

double middle_of_touching(const Surface& surface, const Point<Patient>& centre,
                          const Vector<Patient>& along_mm, int steps, int step, double beside_mm,
                          int& looks) {
  const auto distance_mm = [&](int at) {
    ++looks;
    return surface.distance_mm(place_of_step(centre, along_mm, steps, at));
  };
  const double least_mm = distance_mm(step);
  double all = 1, sum = step;
  for (const int way : {-1, 1}) {
    for (int at = step + way; at >= 0 && at <= steps; at += way) {
      const double weight = 1 - std::abs(distance_mm(at) - least_mm) / beside_mm;
      if (weight <= 0) break;
      all += weight;
      sum += weight * at;
    }
  }
  return sum / all / steps;
}

}  // namespace palpate
