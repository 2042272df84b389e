#include "contact/capsule_row.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

// distance of a step's sphere centre, minus the increase of its radius over the first sphere's
double distance_of_step(const Surface& surface, const Point<Patient>& centre, const ToolPart& shape,
                        int steps, int step) {
  const double fraction = static_cast<double>(step) / steps;
  return surface.distance_mm(centre + shape.axis_mm * fraction) - shape.radius_change_mm * fraction;
}

class RowSearch {
 public:
  RowSearch(const Surface& surface, const Point<Patient>& centre, const ToolPart& shape, int steps,
            double cutoff_mm)
      : surface_(surface),
        centre_(centre),
        shape_(shape),
        steps_(steps),
        rise_mm_((surface.max_gradient() * shape.axis_mm.norm() + std::abs(shape.radius_change_mm)) / steps),
        enough_mm_(cutoff_mm) {}

  double evaluate(int step) {
    ++queries_;
    const double distance_mm = distance_of_step(surface_, centre_, shape_, steps_, step);
    if (distance_mm < nearest_.distance_mm) nearest_ = {distance_mm, step};
    return distance_mm;
  }

  // evaluates steps first ... last by bisection; keeps a lower bound of the distances it skips
  void search(int first, int last) {
    if (first > last) return;
    const int middle = (first + last) / 2;
    const double distance_mm = evaluate(middle);
    const double min_mm = distance_mm - rise_mm_ * (last - middle);
    if (min_mm > std::min(enough_mm_, nearest_.distance_mm)) {
      if (last > first) min_rejected_mm_ = std::min(min_rejected_mm_, min_mm);
      return;
    }
    search(first, middle - 1);
    search(middle + 1, last);
  }

  NearestInRow nearest() const {
    if (nearest_.distance_mm <= enough_mm_) return nearest_;
    return {std::min(nearest_.distance_mm, min_rejected_mm_), nearest_.step};
  }
  int queries() const { return queries_; }

 private:
  const Surface& surface_;
  const Point<Patient>& centre_;
  const ToolPart& shape_;
  const int steps_;
  const double rise_mm_;  // maximum change of the distance from one step to the next
  const double enough_mm_;
  NearestInRow nearest_{std::numeric_limits<double>::infinity(), 0};
  double min_rejected_mm_ = std::numeric_limits<double>::infinity();
  int queries_ = 0;
};

}  // namespace

int row_steps(const ToolPart& part) {
  if (part.axis_mm == Vector<Patient>()) return 0;
  // between two spheres the outline dips by r - sqrt(r^2 - (pitch / 2)^2), which is below pitch^2 / (8 r) *
  // 1.04 for these values
  const double thinnest_mm =
      part.row_radius_mm > 0 ? part.row_radius_mm : std::min(part.radius_mm, part.radius_at_mm(1));
  const double pitch_mm =
      std::max(kProxySettings.min_row_pitch_mm, std::sqrt(7.5 * thinnest_mm * kProxySettings.max_row_gap_mm));
  return static_cast<int>(std::ceil(part.axis_mm.norm() / pitch_mm));
}

NearestInRow nearest_in_row(const Surface& surface, const Point<Patient>& centre, const ToolPart& shape,
                            int steps, int begin, double cutoff_mm, int& queries) {
  RowSearch row(surface, centre, shape, steps, cutoff_mm);
  row.evaluate(begin);
  row.search(0, begin - 1);
  row.search(begin + 1, steps);
  queries += row.queries();
  return row.nearest();
}

NearestPart nearest_part(const Surface& surface, const ToolPart& part, const Point<Patient>& at,
                         double cutoff_mm) {
  const Point<Patient> centre = at + part.offset_mm;
  const int steps = row_steps(part);
  if (steps == 0) return {surface.distance_mm(centre), 0};
  int queries = 0;
  const NearestInRow nearest = nearest_in_row(surface, centre, part, steps, steps / 2, cutoff_mm, queries);
  return {nearest.distance_mm, static_cast<double>(nearest.step) / steps};
}

double middle_of_touching(const Surface& surface, const Point<Patient>& centre, const ToolPart& shape,
                          int steps, int step, double beside_mm, int& queries) {
  const auto distance_mm = [&](int at) {
    ++queries;
    return distance_of_step(surface, centre, shape, steps, at);
  };
  const double min_mm = distance_mm(step);
  double all = 1, sum = step;
  for (const int direction : {-1, 1}) {
    for (int at = step + direction; at >= 0 && at <= steps; at += direction) {
      const double weight = 1 - std::abs(distance_mm(at) - min_mm) / beside_mm;
      if (weight <= 0) break;
      all += weight;
      sum += weight * at;
    }
  }
  return sum / all / steps;
}

}  // namespace palpate
